"""Boards as a user writes them: by `new`, `new --matrix`, `scale`, `tune` and `choose`."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import taction
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from tests.bench.judge import Board, Limits, sheet_of
from tests.support.paths import ROOT

PRESETS: dict[str, dict[str, Any]] = tomllib.loads(
    (ROOT / "spice_models" / "presets.toml").read_text("utf-8")
)
NAMED = tuple(name for name, figures in PRESETS.items() if "offset_voltage" in figures)
MATRICES = ("random", "gauss", "difference")
SOURCES = (*NAMED, "tactile", *MATRICES)


PREFIXES = {"f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
QUANTITY = re.compile(r"±?([-+0-9.e]+)([fpnumkM]?)(?:ohm|F|S|V|s)")


def number(value: object) -> float:
    """Return a quantity of a scene file in its base unit; nan for other texts."""
    if isinstance(value, int | float):
        return float(value)
    found = QUANTITY.fullmatch(str(value))
    return float(found[1]) * PREFIXES.get(found[2], 1.0) if found else math.nan


def command(*words: str | Path) -> int:
    """Run `taction` as a user does; return its exit status."""
    line = [sys.executable, "-m", "taction", *map(str, words)]
    return subprocess.run(line, capture_output=True, timeout=600, check=False).returncode


def write_matrix(name: str, folder: Path, prefix: str) -> list[str | Path]:
    """Write T and eps of a problem; return the options that read them."""
    rng = np.random.default_rng(len(name))
    if name == "random":
        T = rng.normal(size=(6, 4))
    elif name == "gauss":
        apart = np.subtract.outer(np.linspace(-1, 1, 8), np.linspace(-1, 1, 6))
        T = np.exp(-((apart / 0.4) ** 2))
    else:
        T = np.eye(5) - 0.5 * np.eye(5, k=1)
    eps = T @ rng.uniform(0.3, 1.0, T.shape[1])
    for file, values in (("T.csv", T), ("eps.csv", eps[:, None])):
        np.savetxt(folder / f"{prefix}-{file}", values, delimiter=",")
    return ["--matrix", folder / f"{prefix}-T.csv", "--strain", folder / f"{prefix}-eps.csv"]


def passes(file: Path) -> bool:
    """Whether taction says PASS."""
    words = ("verify", file, "--engine", "statespace", "--changes", "0")
    return file.exists() and command(*words) == 0


def written(folder: Path, source: str) -> Iterator[Path]:
    """Write the boards of a source: a preset, or a problem for which op-amps are chosen.

    Yields the scene files of those that pass.
    """
    plain = folder / f"{source}-plain.toml"
    if source in NAMED:
        volts = min(15.0, float(PRESETS[source].get("most_supply", 15.0)))
        own = ["--opamp", source, "--supply", f"±{volts:g}V"]
        matrix = MATRICES[NAMED.index(source) % len(MATRICES)]
        command("new", plain)
        fresh, made = folder / f"{source}-new.toml", folder / f"{source}-{matrix}.toml"
        scaled = folder / f"{source}-scale.toml"
        command("new", "--opamp", source, fresh)
        command("new", *write_matrix(matrix, folder, source), *own, made)
        command("scale", plain, *own, "-o", scaled)
        files = [fresh, made, scaled]
        if passes(fresh):
            files.append(folder / f"{source}-tune.toml")
            command("tune", fresh, "-o", files[-1])
    else:
        options = [] if source == "tactile" else write_matrix(source, folder, source)
        command("new", *options, plain)
        chosen = folder / f"{source}-choose"
        store = folder / f"{source}.sqlite"
        command("choose", plain, "--points", "3", "-o", chosen, "--store", store, "--jobs", "1")
        files = sorted(chosen.glob("*.toml"))
    yield from (file for file in files if passes(file))


def board_of(file: Path) -> Board:
    """Return the deck of a scene file with its limits, and its target by the normal equations."""
    scene = tomllib.loads(file.read_text("utf-8"))
    deck = taction.netlist(file).text
    problem = make_problem(load_scene(file))
    checks, opamp = scene["checks"], scene["design"]["opamp"]["base"]
    T, eps = np.asarray(problem.matrix), np.asarray(problem.strain)
    design = {key: number(value) for key, value in scene["design"].items()}
    unit = design.get("unit_voltage", 1.0)
    lam = design.get("lambda")
    if lam is None:  # eq (21) of the paper, corrected
        lam = 1.0 / (design["resistance"] * design["gain"] * design["unit_conductance"] ** 2)
    return Board(
        name=file.stem,
        deck=deck,
        target=unit * np.linalg.solve(T.T @ T + lam * np.eye(T.shape[1]), T.T @ eps),
        limits=Limits(
            steady=checks["steady_state"]["tolerance"],
            band=checks["settling_time"]["band"],
            settling=number(checks["settling_time"].get("max", math.inf)),
            overshoot=checks.get("overshoot", {}).get("max", math.inf),
        ),
        tolerance=scene.get("tolerances", {}).get("resistor", 0.01),
        sheet=sheet_of(PRESETS[opamp], PRESETS[opamp].get("guaranteed", {})),
    )
