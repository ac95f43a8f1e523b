"""References of a work-precision study: the exact solution, or one with a far smaller tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.reference.dynamics import ideal_linear
from taction.verification.studies.running.worker import FAILURES
from taction.verification.studies.work_precision.methods import (
    MethodRun,
    MethodTask,
    integrate_ideal,
)
from taction.verification.verdict.companion import outputs

TIGHT, TIGHTEST = 1e-12, 1e-13  # tolerances of the board and of the ideal network
STRUCTURED = 1e-9  # of a large board: a smaller tolerance gains nothing over rounding errors
LOOSER = 100.0  # tolerance of the second implicit solution over that of the first

Solve = Callable[[MethodTask, Floats], Floats]


def board_exact(task: MethodTask, time: Floats) -> Floats:
    """Return the exact solution of a linear board, (P, N), V."""
    solution = exact_solution(task.circuit, initial=task.transient.initial)
    return np.array([output.sign for output in task.circuit.outputs]) * solution.at(time)


def board_implicit(task: MethodTask, time: Floats, looser: float = 1.0) -> Floats:
    """Return the solution of the adaptive implicit engine, (P, N), V."""
    tolerance = STRUCTURED if LinearBoard(task.circuit).descriptor.is_large else TIGHT
    waveforms = stepped.simulate(
        task.circuit, task.transient, times=time, tolerance=looser * tolerance
    )
    return outputs(task.circuit, waveforms)


def ideal_exact(task: MethodTask, time: Floats) -> Floats:
    """Return the exact solution of an ideal network with linear amplifiers, (P, N), V."""
    return ideal_linear(task.network, task.v0).outputs(time)


def ideal_dop853(task: MethodTask, time: Floats) -> Floats:
    """Return the solution of the ideal network by an explicit method of order 8, (P, N), V."""
    return integrate_ideal(task, TIGHTEST, "DOP853", time)[1]


def ideal_lsoda(task: MethodTask, time: Floats) -> Floats:
    """Return the solution of the ideal network by LSODA, (P, N), V."""
    return integrate_ideal(task, TIGHTEST, "LSODA", time)[1]


def solvers(task: MethodTask, problem: str) -> tuple[tuple[str, Solve], tuple[str, Solve]]:
    """Return the two solutions of a problem by their names, the better first.

    The exact ones need a linear board, and the one of a board dense matrices.
    """
    linear = task.circuit.is_linear
    implicit = (f"state space, implicit at {TIGHT:g}", board_implicit)
    explicit = (f"DOP853 at {TIGHTEST:g}", ideal_dop853)
    if problem == "ideal":
        exact = ("exact modes", ideal_exact)
        return (exact, explicit) if linear else (explicit, (f"LSODA at {TIGHTEST:g}", ideal_lsoda))
    if linear and not LinearBoard(task.circuit).descriptor.is_large:
        return ("state space, exact", board_exact), implicit
    second = partial(board_implicit, looser=LOOSER)
    return implicit, (f"state space, implicit at {LOOSER:g} times its tolerance", second)


@dataclass(frozen=True, slots=True, eq=False)
class References:
    """Two solutions of one problem at the compared instants of its runs.

    Attributes
    ----------
    references : tuple of str
        Their names, the one that runs are compared with first.
    time, u : ndarray (P,) and (P, N)
        Instants, s, and outputs of the first, V.
    floor : float or None
        Largest difference of the two over the step amplitude; None where the second failed.
    second : ndarray (P, N) or None
        Outputs of the second, V.
    amplitude : float
        Step amplitude, V: the largest distance of an output from its start.
    omissions : tuple of str
        Solutions that failed, and why.
    """

    DOCUMENT = ("references", "reference_error = floor", "step_amplitude [V] = amplitude")

    references: tuple[str, ...]
    time: Floats
    u: Floats
    floor: float | None
    second: Floats | None
    amplitude: float
    omissions: tuple[str, ...]

    @classmethod
    def of(
        cls,
        task: MethodTask,
        problem: str,
        runs: Sequence[MethodRun],
        call: Callable[[Solve, MethodTask, Floats], Floats],
    ) -> References:
        """Solve a problem at all instants of `runs`; `call` runs a solver within its time limit."""
        time = np.unique(np.concatenate([[0.0], *(run.time for run in runs)]))
        names, found, omissions = list[str](), list[Floats](), list[str]()
        for name, solve in solvers(task, problem):
            try:
                found.append(call(solve, task, time))
                names.append(name)
            except (TimeoutError, *FAILURES) as error:
                omissions.append(f"reference of the {problem}, {name}: {error}")
        if not found:
            return cls((), time, np.zeros((len(time), 0)), None, None, 1.0, tuple(omissions))
        amplitude = float(np.abs(found[0] - found[0][0]).max()) or 1.0
        second = found[1] if len(found) > 1 else None
        floor = None if second is None else float(np.abs(second - found[0]).max() / amplitude)
        return cls(tuple(names), time, found[0], floor, second, amplitude, tuple(omissions))

    def error(self, run: MethodRun, name: str) -> tuple[float | None, str]:
        """Return a run's largest error over the step amplitude, and the name of its reference.

        A method with the name of the first solution is compared with the second.
        """
        own = bool(self.references) and self.references[0] == name
        u = self.second if own else (self.u if self.references else None)
        if u is None:
            return None, ""
        expected = u[np.searchsorted(self.time, run.time)]
        return float(np.abs(run.u - expected).max() / self.amplitude), self.references[int(own)]
