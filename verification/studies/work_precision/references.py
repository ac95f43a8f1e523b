"""References of a work-precision study, each by another solver than the method that it measures.

The exact solution where there is one, else an integrator at a far tighter tolerance. Every problem
has two references, and their difference estimates their error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import amplified, structured_radau
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.reference.dynamics import ideal_linear
from taction.verification.studies.work_precision.method_runs import (
    Integrator,
    Task,
    any_board,
    integrate_ideal,
    linear_board,
    small_board,
    small_linear_board,
)
from taction.verification.verdict.simulation import outputs

TIGHT = 1e-12
TIGHTEST = 1e-13
STRUCTURED = 1e-9  # a smaller tolerance gains nothing over rounding errors
ABSOLUTE = 1e-3  # absolute over relative tolerance, so that small states are accurate, too
NEEDED = 2  # references of each problem


@dataclass(frozen=True, slots=True)
class ReferenceMethod:
    """A way to compute a reference solution.

    `refuses` returns why a board is not for the method (empty if it is), `compute` the outputs at
    given times, (P, N), V.
    """

    name: str
    solver: str  # see `taction.verification.studies.work_precision.methods.Method.solver`
    refuses: Callable[[Circuit], str]
    compute: Callable[[Task, Floats], Floats]


def board_exact(task: Task, time: Floats) -> Floats:
    """Return the exact solution of a linear board."""
    solution = exact_solution(task.circuit, initial=task.transient.initial, stop=float(time[-1]))
    return _signs(task) * solution.at(time)


def board_implicit(task: Task, time: Floats) -> Floats:
    """Return the solution of the adaptive implicit engine."""
    waveforms = amplified.simulate(task.circuit, task.transient, times=time, tolerance=TIGHT)
    return outputs(task.circuit, waveforms)


def board_structured(task: Task, time: Floats) -> Floats:
    """Return the solution of the structured engine for linear boards."""
    waveforms = structured_radau.simulate(
        task.circuit, task.transient, times=time, tolerance=STRUCTURED
    )
    return outputs(task.circuit, waveforms)


def board_lsoda(task: Task, time: Floats) -> Floats:
    """Return the solution of the board's equations by ODEPACK's LSODA; EngineError if it fails."""
    from scipy.integrate import solve_ivp

    board = LinearBoard(task.circuit)
    system = amplified.Amplified(board, board.reported(None))
    solution = solve_ivp(
        lambda _, x: system.rate(x), (0.0, float(time[-1])),
        system.start(task.transient), "LSODA", t_eval=time,
        jac=lambda _, x: system.jacobian(x), rtol=TIGHT, atol=ABSOLUTE * TIGHT,
    )  # fmt: skip
    y = solution.y
    if not solution.success or y.shape[1] != len(time) or not np.all(np.isfinite(y)):
        raise EngineError(f"LSODA gave up: {solution.message}")
    return _signs(task) * system.report(system.watch(y).T)


def ideal_exact(task: Task, time: Floats) -> Floats:
    """Return the exact solution of an ideal network with linear amplifiers."""
    return ideal_linear(task.network, task.v0).outputs(time)


def ideal_integrated(task: Task, time: Floats, method: Integrator) -> Floats:
    """Return the solution of the ideal network by an integrator of SciPy."""
    return integrate_ideal(task, TIGHTEST, method, time)[1]


def _signs(task: Task) -> Floats:
    return np.array([output.sign for output in task.circuit.outputs])


# In the order of preference.
REFERENCES = {
    "board": (
        ReferenceMethod("state space, exact", "modes", small_linear_board, board_exact),
        ReferenceMethod(
            f"state space, implicit at {TIGHT:g}", "Radau IIA, 5 stages", any_board, board_implicit
        ),
        ReferenceMethod(
            f"state space, structured at {STRUCTURED:g}", "Radau IIA, 7 stages", linear_board,
            board_structured,
        ),
        ReferenceMethod(
            f"LSODA at {TIGHT:g} on the state space", "LSODA", small_board, board_lsoda
        ),
    ),
    "ideal": (
        ReferenceMethod("exact modes", "modes", linear_board, ideal_exact),
        ReferenceMethod(
            f"DOP853 at {TIGHTEST:g}", "DOP853", any_board,
            partial(ideal_integrated, method="DOP853"),
        ),
        ReferenceMethod(
            f"LSODA at {TIGHTEST:g}", "LSODA", any_board, partial(ideal_integrated, method="LSODA")
        ),
    ),
}  # fmt: skip
