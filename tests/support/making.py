"""Scenes and problems for tests, without a scene file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene, parse_scene

NEAR_IDEAL = {"base": "ideal", "dc_gain": 1e12}


def make_scene(problem: dict[str, Any] | None = None, **tables: Any) -> Scene:
    """A tactile scene with the defaults but for `problem` and the tables given by name.

    Its op-amps have no input errors unless the table of the op-amp names a level.
    """
    design = dict(tables.pop("design", {}))
    design["opamp"] = without_input_errors(design.get("opamp", "ua741"))
    whole = {"problem": {"kind": "tactile", **(problem or {})}, "design": design, **tables}
    return parse_scene(whole, "scene.toml")


def without_input_errors(opamp: str | dict[str, Any]) -> dict[str, Any]:
    """The table of an op-amp of which a scene judges other things than its DC errors."""
    table = {"base": opamp} if isinstance(opamp, str) else opamp
    return table if "file" in table else {"input_errors": "none", **table}


# Three channels that ring at 166 kHz, for 22 periods.
RINGING: dict[str, Any] = {
    "capacitance": 1e-11,
    "resistance": 14.4e6,
    "gain": 2.3e6,
    "unit_conductance": 1.16e-6,
    "stray_capacitance": 2.05e-12,
    "opamp": {
        "base": "ideal",
        "dc_gain": 1e5,
        "gbw": 0.9e6,
        "second_pole": 2.7e6,
        "output_resistance": 75.0,
    },
}


def ringing_scene(design: dict[str, Any] | None = None, **analysis: Any) -> Scene:
    """The scene of `RINGING`, with changes of its design, and an analysis."""
    problem = {"channels": 3, "span": 2.0}
    return make_scene(problem, design=RINGING | (design or {}), analysis=analysis)


def matrix_problem(T: ArrayLike, eps: ArrayLike) -> InverseProblem:
    return InverseProblem(np.array(T, float), np.array(eps, float), None, None)


def write_matrix_scene(folder: Path, T: ArrayLike, eps: ArrayLike, rest: str = "") -> Path:
    """Write a scene of kind matrix and its CSV files; `rest` is more TOML."""
    rows: list[NDArray[np.float64]] = [np.atleast_1d(row) for row in np.array(T, float)]
    (folder / "T.csv").write_text("".join(",".join(map(repr, r.tolist())) + "\n" for r in rows))
    (folder / "eps.csv").write_text("".join(f"{e!r}\n" for e in np.array(eps, float).tolist()))
    scene = folder / "scene.toml"
    scene.write_text(
        f'[problem]\nkind = "matrix"\nmatrix = "T.csv"\nstrain = "eps.csv"\n{rest}\n',
        encoding="utf-8",
    )
    return scene
