"""How far each varying component moves the outputs at rest, to first order."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.board.variation import INPUT_ERROR, Parameter, vary
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.studies.tolerance.varied_board import VariedBoard

PROBE = 1e-3  # of the tolerance: the error of a central difference is its square
DYNAMIC = ("capacitor", "stray", "opamp_gbw")  # kinds that move no equilibrium


def rest_slopes(board: VariedBoard) -> Floats:
    """Return the change of each output for a deviation of one tolerance, V, (components, N).

    Resistors are exact, by adjoint sensitivities. For the others the equations, not their solution,
    are differenced.

    Raises
    ------
    EngineError
        The nominal board has no equilibrium.

    Notes
    -----
    Costs one factorisation of all unknowns, and two sets of equations for each op-amp.
    """
    sensitivity = RestSensitivity.of(LinearBoard(board.nominal))
    resistors, errors, rows = sensitivity.resistors(), sensitivity.input_errors(), []
    for place, parameter in enumerate(board.varied):
        if parameter.kind == "resistor":
            rows.append(resistors[parameter.name] * math.log1p(parameter.tolerance))
        elif parameter.kind == INPUT_ERROR:
            rows.append(errors[parameter.name] * parameter.tolerance)
        elif parameter.kind in DYNAMIC:
            rows.append(np.zeros(len(board.nominal.outputs)))
        else:
            rows.append(_probed(board, sensitivity, place))
    return np.array(rows)


def _probed(board: VariedBoard, sensitivity: RestSensitivity, place: int) -> Floats:
    z = np.zeros(len(board.varied))
    z[place] = PROBE
    tolerances = board.scene.tolerances
    up, down = (sensitivity.towards(vary(board.nominal, tolerances, s * z)) for s in (1.0, -1.0))
    return np.asarray((up - down) / (2.0 * PROBE))


def largest_parts(
    slopes: Floats, varied: tuple[Parameter, ...], signs: Floats, count: int
) -> tuple[str, ...]:
    """Return the components with the largest `slopes` (components,), with their `signs`."""
    order = np.argsort(-np.abs(slopes), kind="stable")[:count].tolist()
    return tuple(f"{'+' if signs[k] > 0 else '-'}{varied[k].name}" for k in order if signs[k])
