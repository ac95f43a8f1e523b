"""The parts that a scene does not need, and why: for ``--explain`` and the deck's header."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.board.circuit import Omission
from taction.netlist_gen.board.pruning import pruning_omission
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats


def list_omissions(
    scene: Scene, problem: InverseProblem, kept: Floats, model: OpAmp
) -> tuple[Omission, ...]:
    """Return everything that the board of `scene` omits; `kept` (M, N) is T after pruning."""
    pruning = pruning_omission(problem.matrix, scene.design.prune)
    omissions = [] if pruning is None else [pruning]
    omissions += [*_matrix(problem, kept), *_inverters(scene, kept), *_amplifier(scene)]
    omissions += _macromodel(model)
    if scene.design.stray_capacitance == 0:
        omissions.append(Omission("stray capacitors", "design.stray_capacitance is 0"))
    return tuple(omissions)


def _matrix(problem: InverseProblem, T: Floats) -> list[Omission]:
    found = []
    zeros = int(np.count_nonzero(problem.matrix == 0))
    if zeros:
        found.append(Omission(f"{2 * zeros} matrix resistors", f"{zeros} entries of T are zero"))
    rows = int(np.count_nonzero(~T.any(axis=1)))
    if rows:
        why = "their rows of T are all zeros: they would see no output"
        found.append(Omission(f"{rows} constraint nodes", why))
    silent = int(np.count_nonzero((problem.strain == 0) & T.any(axis=1)))
    if silent:
        found.append(Omission(f"{silent} strain currents", "their strain is zero"))
    return found


def _inverters(scene: Scene, T: Floats) -> list[Omission]:
    linear, passive = scene.design.amplifier == "linear", scene.design.topology == "passive"
    columns = int(np.count_nonzero(~((T > 0) if linear else (T < 0)).any(axis=0)))
    rows = int(np.count_nonzero(T.any(axis=1) & ~((T > 0) if passive else (T < 0)).any(axis=1)))
    found = []
    if columns:
        sign = "positive" if linear else "negative"
        found.append(Omission(f"{columns} inverters of u", f"their columns have no {sign} entry"))
    if rows:
        sign = "positive" if passive else "negative"
        found.append(Omission(f"{rows} inverters of w", f"their rows have no {sign} entry"))
    return found


def _amplifier(scene: Scene) -> list[Omission]:
    if scene.design.amplifier == "linear":
        why = "linear amplifiers: the regulariser is the sum of squares"
        return [Omission("antilog stages and bias current", why)]
    if not scene.design.biased:
        return [Omission("bias current", "design.bias is false, or the amplifier needs none")]
    return []


def _macromodel(model: OpAmp) -> list[Omission]:
    figures = (
        ("first pole", "gbw", math.inf),
        ("second pole", "second_pole", math.inf),
        ("input resistance", "input_resistance", math.inf),
        ("differential input capacitance", "differential_capacitance", 0.0),
        ("input capacitance", "input_capacitance", 0.0),
        ("output resistance", "output_resistance", 0.0),
    )
    return [
        Omission(f"op-amp {what}", f"{model.name}.{figure} is {empty:g}")
        for what, figure, empty in figures
        if getattr(model, figure) == empty
    ]
