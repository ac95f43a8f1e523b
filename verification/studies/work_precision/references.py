"""References of a work-precision study: each by another solver than the method that it judges.

The exact solution where there is one, an integrator at a far tighter tolerance elsewhere. Of every
problem there are two, so their difference says how far they can be believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients import amplified, structured_radau
from verification.engines.statespace.transients.exact import exact_solution
from verification.pipeline.simulation import outputs
from verification.reference.dynamics import ScaledNetwork, ideal_linear
from verification.studies.work_precision.method_runs import (
    Task,
    any_board,
    linear_board,
    small_board,
    small_linear_board,
)

TIGHT = 1e-12
TIGHTEST = 1e-13
STRUCTURED = 1e-9  # below, rounding stops it
ABSOLUTE = 1e-3  # of a state's own relative tolerance: small states count, too


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """A reference solution at given instants.

    Attributes
    ----------
    name, solver : str
        What it is; who computed it, as
        `verification.studies.work_precision.methods.Method.solver` has it.
    u : ndarray (P, N)
        V.
    """

    name: str
    solver: str
    u: Floats


def board_exact(task: Task, time: Floats) -> Reference:
    """Exact solution of a linear board."""
    found = exact_solution(task.circuit, initial=task.transient.initial, stop=float(time[-1]))
    signs = np.array([output.sign for output in task.circuit.outputs])
    return Reference("state space, exact", "modes", signs * found.at(time))


def board_implicit(task: Task, time: Floats) -> Reference:
    """Adaptive implicit engine at 1e-12."""
    found = amplified.simulate(task.circuit, task.transient, times=time, tolerance=TIGHT)
    u = outputs(task.circuit, found)
    return Reference(f"state space, implicit at {TIGHT:g}", "Radau IIA, 5 stages", u)


def board_structured(task: Task, time: Floats) -> Reference:
    """Structured engine for linear boards at 1e-9."""
    found = structured_radau.simulate(
        task.circuit, task.transient, times=time, tolerance=STRUCTURED
    )
    u = outputs(task.circuit, found)
    return Reference(f"state space, structured at {STRUCTURED:g}", "Radau IIA, 7 stages", u)


def board_lsoda(task: Task, time: Floats) -> Reference:
    """ODEPACK's LSODA at 1e-12 on the board's equations.

    Raises
    ------
    EngineError
        It gave up.
    """
    from scipy.integrate import solve_ivp

    circuit = task.circuit
    board = LinearBoard(circuit)
    system = amplified.Amplified(board, board.reported(None))
    found = solve_ivp(
        lambda _, x: system.rate(x), (0.0, float(time[-1])),
        system.start(task.transient), "LSODA", t_eval=time,
        jac=lambda _, x: system.jacobian(x), rtol=TIGHT, atol=ABSOLUTE * TIGHT,
    )  # fmt: skip
    if not found.success or found.y.shape[1] != len(time) or not np.all(np.isfinite(found.y)):
        raise EngineError(f"LSODA gave up: {found.message}")
    u = system.report(system.watch(found.y).T)
    signs = np.array([output.sign for output in circuit.outputs])
    return Reference(f"LSODA at {TIGHT:g} on the state space", "LSODA", signs * u)


def ideal_exact(task: Task, time: Floats) -> Reference:
    """Exact solution of an ideal network with linear amplifiers."""
    return Reference("exact modes", "modes", ideal_linear(task.network, task.v0).outputs(time))


def ideal_explicit(task: Task, time: Floats) -> Reference:
    """Dormand and Prince's explicit method of order 8 at 1e-13 on the ideal network."""
    return _ideal(task, time, "DOP853", TIGHTEST)


def ideal_lsoda(task: Task, time: Floats) -> Reference:
    """LSODA at 1e-13 on the ideal network."""
    return _ideal(task, time, "LSODA", TIGHTEST)


def _ideal(
    task: Task, time: Floats, method: Literal["DOP853", "LSODA"], tolerance: float
) -> Reference:
    from scipy.integrate import solve_ivp

    network, scaled = task.network, ScaledNetwork(task.network)
    unit = network.R * network.C
    found = solve_ivp(
        scaled.slope, (0.0, float(time[-1]) / unit), task.v0 / network.unit, method,
        t_eval=time / unit, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    if not found.success or found.y.shape[1] != len(time) or not np.all(np.isfinite(found.y)):
        raise EngineError(f"{method} gave up: {found.message}")
    u = network.U0 * scaled.g.g(found.y).T
    return Reference(f"{method} at {tolerance:g}", method, u)


# In the order of preference: why a board is not for it, and the function.
REFERENCES = {
    "board": (
        (small_linear_board, board_exact),
        (any_board, board_implicit),
        (linear_board, board_structured),
        (small_board, board_lsoda),
    ),
    "ideal": ((linear_board, ideal_exact), (any_board, ideal_explicit), (any_board, ideal_lsoda)),
}
NEEDED = 2
