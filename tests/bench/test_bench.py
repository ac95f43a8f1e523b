"""Boards as a user writes them, on the bench: as written and drawn, and faults that it must find.

With every commit two boards; `make boards` writes those of every preset and problem by `new`,
`new --matrix`, `scale`, `tune` and `choose`, and judges each that passes by 100 drawn ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import load_scene
from taction.spice_models.presets import tables
from tests.bench import judge
from tests.bench.judge import Board, Limits, fault, judged, sheet_of
from tests.support.running import python

PRESETS = tables()
NAMED = tuple(name for name, figures in PRESETS.items() if "offset_voltage" in figures)
MATRICES = ("random", "gauss", "difference")


def write_matrix(name: str, folder: Path) -> list[str]:
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
        np.savetxt(folder / file, values, delimiter=",")
    return ["--matrix", str(folder / "T.csv"), "--strain", str(folder / "eps.csv")]


def command(*words: object) -> int:
    """Run `taction` as a user does; return its exit status."""
    return python("-m", "taction", *map(str, words), timeout=600).returncode


def passes(file: Path) -> bool:
    """Whether taction says PASS."""
    words = ("verify", file, "--engine", "statespace", "--changes", "0")
    return file.exists() and command(*words) == 0


def written(folder: Path, source: str) -> Iterator[Path]:
    """Yield the boards that pass of a preset, or of a problem for which op-amps are chosen."""
    plain = folder / "plain.toml"
    if source in NAMED:
        volts = min(15.0, float(PRESETS[source].get("most_supply", 15.0)))
        own = ["--opamp", source, "--supply", f"±{volts:g}V"]
        matrix = MATRICES[NAMED.index(source) % len(MATRICES)]
        files = [folder / f"{name}.toml" for name in ("fresh", "matrix", "scaled", "tuned")]
        command("new", plain)
        command("new", "--opamp", source, files[0])
        command("new", *write_matrix(matrix, folder), *own, files[1])
        command("scale", plain, *own, "-o", files[2])
        if passes(files[0]):
            command("tune", files[0], "-o", files[3])
    else:
        command("new", *([] if source == "tactile" else write_matrix(source, folder)), plain)
        more = ("--store", folder / "a.sqlite", "--jobs", "1")
        command("choose", plain, "--points", "3", "-o", folder / "chosen", *more)
        files = sorted((folder / "chosen").glob("*.toml"))
    yield from (file for file in files if passes(file))


def board_of(file: Path) -> Board:
    """Return the deck of a scene file with its limits, and its target by the normal equations."""
    scene = load_scene(file)
    problem, checks, design = make_problem(scene), scene.checks, scene.design
    T, eps, lam = np.asarray(problem.matrix), np.asarray(problem.strain), design.lam
    if lam is None:  # eq (21) of the paper, corrected
        assert design.resistance is not None
        lam = 1.0 / (design.resistance * design.gain * design.unit_conductance**2)
    sheet = PRESETS[design.opamp.base]
    given = (checks.settling_time.max, checks.overshoot and checks.overshoot.max)
    largest = (math.inf if limit is None else limit for limit in given)
    return Board(
        name=file.stem,
        deck=taction.netlist(file).text,
        target=design.unit_voltage * np.linalg.solve(T.T @ T + lam * np.eye(T.shape[1]), T.T @ eps),
        limits=Limits(checks.steady_state.tolerance, checks.settling_time.band, *largest),
        tolerance=scene.tolerances.resistor or 0.01,
        sheet=sheet_of(sheet, sheet.get("guaranteed", {})),
    )


@pytest.mark.nightly
@pytest.mark.parametrize("source", [*NAMED, "tactile", *MATRICES])
def test_every_board_that_commands_write_holds_its_pass(
    source: str, tmp_path: Path, ngspice: str
) -> None:
    found = [judged(board_of(file), ngspice, 100, 1) for file in written(tmp_path, source)]
    assert [(each.name, each.as_written, each.passing) for each in found if not each.good] == []
    assert found or source in NAMED  # of a preset none may pass


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Board:
    file = tmp_path_factory.mktemp("bench") / "board.toml"
    taction.new(file)
    return board_of(file)


def test_a_fresh_board_passes_on_the_bench(fresh: Board, ngspice: str) -> None:
    assert judged(fresh, ngspice, 20, 1).good


def test_a_board_for_a_matrix_passes_on_the_bench(tmp_path: Path, ngspice: str) -> None:
    _, matrix, _, strain = write_matrix("random", tmp_path)
    made = taction.new(tmp_path / "board.toml", matrix=matrix, strain=strain, opamp="ad711")
    assert made.outcome == "pass"
    board = board_of(Path(made.file))
    assert 10.0 <= min(parts(board.deck).values()) <= max(parts(board.deck).values()) <= 10e6
    assert judged(board, ngspice, 20, 1).good


def test_a_wrong_pass_is_found(fresh: Board, ngspice: str) -> None:
    """A uA741 (80 nA in megohms), a limit that 1 % resistors break, and another target."""
    weak = sheet_of({"offset_voltage": 1e-3, "bias_current": 80e-9}, {"bias_current": 500e-9})
    assert judged(replace(fresh, sheet=weak), ngspice, 10, 1).passing < 0.95
    tight = replace(fresh, limits=Limits(1e-3, 0.04))
    assert judged(tight, ngspice, 10, 1).passing < 0.95
    off = replace(fresh, target=1.05 * fresh.target)
    assert judged(off, ngspice, 1, 1).as_written.startswith("rests")


def parts(deck: str) -> dict[str, float]:
    """Return the resistors of the board, ohm; those of a macromodel have no '_' in their names."""
    found = filter(None, map(judge.RESISTOR.match, deck.split("\n")))
    return {part[1]: float(part[4]) for part in found if "_" in part[1]}


def test_limits_by_hand_made_records() -> None:
    time, target = np.linspace(0.0, 1.0, 101), np.array([1.0, -0.5])
    rise = 1.0 - np.exp(-time / 0.05)
    board = Board("a", "", target, Limits(0.01, 0.02, 0.5, 0.1), 0.01, {})
    assert fault(board, time, rise[:, None] * target) == ""
    assert fault(board, time, rise[:, None] * target * 1.02).startswith("rests 0.02")
    late = replace(board, limits=Limits(0.01, 0.02, 0.1))
    assert fault(late, time, rise[:, None] * target).startswith("settles after 0.2")
    ringing = target * (1.0 + 0.3 * np.exp(-time / 0.05) * np.cos(20 * time))[:, None]
    assert fault(board, time, ringing).startswith("overshoots by 0.3")
