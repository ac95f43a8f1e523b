"""Errors of runs: norms, references, and a run beside its reference."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.engines.statespace.transients.small_steps import StateBoard
from taction.verification.readings.readings import settling_times
from taction.verification.readings.ringing import GOOD_FIT, find_ringing
from taction.verification.readings.signals import FEWEST_POINTS, SampledSignal
from taction.verification.reference.dynamics import ideal_linear
from taction.verification.reference.solve import solve
from taction.verification.studies.running.worker import FAILURES, Worker
from taction.verification.studies.work_precision.ladders import SettingRuns
from taction.verification.studies.work_precision.methods import (
    Integrator,
    MethodRun,
    MethodTask,
    any_board,
    integrate_ideal,
    linear_board,
    small_board,
    small_linear_board,
)
from taction.verification.verdict.companion import outputs

NORMS = ("final", "maximum", "settling_time", "frequency", "growth_rate")
MARGIN = 1.25  # band over the largest deviation in the last part of the record
LAST = 0.8  # start of the last part, fraction of the record
FEWEST_FITTED = 32  # points of a record in which a ringing is fitted
OTHER_MODE = 0.2  # relative distance of a fitted pole that belongs to another mode

Errors = dict[str, float | None]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorScale:
    """Properties of the reference on which the norms depend."""

    target: Floats  # equilibrium, (N,), V
    amplitude: float  # step amplitude A, V
    band: float  # half width of the settling band, fraction of A
    settling_time: float | None  # s; None: not settled in the record
    ringing: complex | None  # fitted mode, 1/s; None: no mode rings long enough


def make_scale(
    time: Floats, u: Floats, start: Floats, target: Floats, band: float, pole: complex | None
) -> ErrorScale:
    """Return the scale of a reference record, with a wider band if the record is too short.

    Parameters
    ----------
    time, u : ndarray (P,) and (P, N)
        Reference record, s and V.
    start, target : ndarray (N,)
        Outputs just after the step and at the equilibrium, V.
    band : float
        Settling band of the scene, fraction of the step amplitude.
    pole : complex or None
        Pole of the linearised board that rings longest, 1/s.
    """
    amplitude = float(np.abs(target - start).max()) or 1.0
    late = np.abs(u[time >= LAST * time[-1]] - target).max() / amplitude
    if late > band:
        band = float(f"{MARGIN * late:.2g}")
    settling = settling_time(time, u, target, band * amplitude)
    return ErrorScale(target, amplitude, band, settling, fit_ringing(time, u, pole))


def settling_time(time: Floats, u: Floats, target: Floats, tolerance: float) -> float | None:
    """Return the settling time of the slowest channel, s; None if a channel does not settle."""
    if len(time) < FEWEST_POINTS:
        return None
    readings = settling_times(SampledSignal(time, (u - target).T), tolerance)
    times = [reading.value for reading in readings if reading is not None]
    return max(times) if len(times) == len(readings) else None


def fit_ringing(time: Floats, u: Floats, expected: complex | None) -> complex | None:
    """Return the fitted mode of a record, 1/s, or None if it is too far from `expected`."""
    if expected is None or not expected.imag or len(time) < FEWEST_FITTED:
        return None
    mode = find_ringing(time, u, math.tau / abs(expected.imag)).mode
    if mode is None or mode.residual > GOOD_FIT:
        return None
    found = complex(mode.growth_rate, 2 * math.pi * mode.frequency)
    return None if abs(found - expected) > OTHER_MODE * abs(expected) else found


def measure_errors(run: MethodRun, reference: Floats, scale: ErrorScale) -> Errors:
    """Return the errors of a run by norm, None where a norm does not apply.

    `reference` holds the outputs of the reference at the instants of the run, (P, N), V.
    """
    difference = np.abs(run.u - reference) / scale.amplitude
    settling, expected_settling = (
        settling_time(run.time, u, scale.target, scale.band * scale.amplitude)
        for u in (run.u, reference)
    )
    errors: Errors = dict.fromkeys(NORMS)
    errors |= {"final": float(difference[-1].max()), "maximum": float(difference.max())}
    if settling and expected_settling:
        errors["settling_time"] = abs(settling / expected_settling - 1.0)
    mode, expected = (fit_ringing(run.time, u, scale.ringing) for u in (run.u, reference))
    if mode is not None and expected is not None:
        errors["frequency"] = abs(mode.imag / expected.imag - 1.0)
        errors["growth_rate"] = abs(mode.real - expected.real) / abs(expected)
    return errors


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
    compute: Callable[[MethodTask, Floats], Floats]


def board_exact(task: MethodTask, time: Floats) -> Floats:
    """Return the exact solution of a linear board."""
    solution = exact_solution(task.circuit, initial=task.transient.initial)
    return _signs(task) * solution.at(time)


def board_implicit(task: MethodTask, time: Floats) -> Floats:
    """Return the solution of the adaptive implicit engine."""
    tolerance = STRUCTURED if LinearBoard(task.circuit).descriptor.is_large else TIGHT
    waveforms = stepped.simulate(task.circuit, task.transient, times=time, tolerance=tolerance)
    return outputs(task.circuit, waveforms)


def board_lsoda(task: MethodTask, time: Floats) -> Floats:
    """Return the solution of the board's equations by ODEPACK's LSODA; EngineError if it fails."""
    from scipy.integrate import solve_ivp

    board = LinearBoard(task.circuit)
    run = stepped.SteppedRun.of(stepped.Task(board, task.transient, None, time, TIGHT))
    if not isinstance(run.board, StateBoard):
        raise EngineError("the board is too large for LSODA")
    rate, jacobian, watch = run.board.equations(run.reported.amplifiers)
    solution = solve_ivp(
        lambda _, e: rate(e), (0.0, float(time[-1])), run.state, "LSODA", t_eval=time,
        jac=lambda _, e: jacobian(e), rtol=TIGHT, atol=ABSOLUTE * TIGHT,
    )  # fmt: skip
    e = solution.y
    if not solution.success or e.shape[1] != len(time) or not np.all(np.isfinite(e)):
        raise EngineError(f"LSODA gave up: {solution.message}")
    return _signs(task) * run.reported.voltages(watch(e))


def ideal_exact(task: MethodTask, time: Floats) -> Floats:
    """Return the exact solution of an ideal network with linear amplifiers."""
    return ideal_linear(task.network, task.v0).outputs(time)


def ideal_integrated(task: MethodTask, time: Floats, method: Integrator) -> Floats:
    """Return the solution of the ideal network by an integrator of SciPy."""
    return integrate_ideal(task, TIGHTEST, method, time)[1]


def _signs(task: MethodTask) -> Floats:
    return np.array([output.sign for output in task.circuit.outputs])


# In the order of preference.
REFERENCES = {
    "board": (
        ReferenceMethod("state space, exact", "modes", small_linear_board, board_exact),
        ReferenceMethod(
            f"state space, implicit at {TIGHT:g}", "Radau IIA, 9 stages", any_board, board_implicit
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


SHARE = 0.6  # of the remaining time that one reference may take
COMPARED = 500  # instants of the second reference where no run needs it


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceRun:
    """A reference solution."""

    name: str
    solver: str
    time: Floats  # (P,), s
    u: Floats  # (P, N), V

    def at(self, time: Floats) -> Floats:
        """Return the outputs at some of the reference's instants."""
        return self.u[np.searchsorted(self.time, time)]


@dataclass(frozen=True, slots=True, eq=False)
class ProblemErrors:
    """Errors of all runs of one problem."""

    DOCUMENT = (
        *("references", "reference_error = floor", "step_amplitude [V] = scale.amplitude"),
        *("settling_band = scale.band", "settling_time [s] = scale.settling_time"),
        "ringing [1/s] = scale.ringing",
    )

    # by method's name and setting: errors by norm, and the name of the reference
    errors: Mapping[tuple[str, float], tuple[Errors, str]] = field(default_factory=dict)
    references: tuple[str, ...] = ()  # names, the preferred reference first
    scale: ErrorScale | None = None  # None without a reference
    # difference of the preferred reference to the second reference, None where unknown
    floor: Errors = field(default_factory=lambda: dict.fromkeys(NORMS))
    omissions: tuple[str, ...] = ()  # runs and references without result, and why


def measure_runs(
    task: MethodTask,
    entries: Sequence[SettingRuns],
    band: float,
    pole: complex | None,
    worker: Worker,
    seconds: float,
) -> dict[str, ProblemErrors]:
    """Measure every run; a problem without a reference has no errors, and an omission.

    Parameters
    ----------
    band : float
        The scene's settling band, fraction of the step amplitude.
    pole : complex or None
        The board's ringing pole, 1/s.
    seconds : float
        Time limit of the references, s.
    """
    end, problems = clock.perf_counter() + seconds, {}
    for problem, ringing in (("ideal", None), ("board", pole)):  # an ideal network never rings
        completed = [t for t in entries if t.method.problem == problem and t.run is not None]
        target = _board_target(task) if problem == "board" else _ideal_target(task)
        problems[problem] = _measure(task, problem, completed, target, band, ringing, worker, end)
    return {problem: problems[problem] for problem in ("board", "ideal")}


def _measure(
    task: MethodTask,
    problem: str,
    entries: Sequence[SettingRuns],
    target: Floats,
    band: float,
    pole: complex | None,
    worker: Worker,
    end: float,
) -> ProblemErrors:
    runs = [entry.run for entry in entries if entry.run is not None]
    if not runs:
        return ProblemErrors()
    references, omissions = _references(task, problem, entries, worker, end)
    if not references:
        return ProblemErrors(omissions=(*omissions, f"{problem}: no errors without a reference"))
    best = references[0]
    time = max(runs, key=lambda run: len(run.time)).time  # the union of all has needless clusters
    scale = make_scale(time, best.at(time), best.u[0], target, band, pole)
    errors = {}
    for entry in entries:
        reference = next((r for r in references if r.solver != entry.method.solver), None)
        if entry.run is not None and reference is not None:
            measured = measure_errors(entry.run, reference.at(entry.run.time), scale)
            errors[entry.method.name, entry.setting] = measured, reference.name
        else:
            omissions.append(f"{entry.method.name}: no reference by another solver")
    names = tuple(reference.name for reference in references)
    floor = _floor(references, scale)
    return ProblemErrors(errors, names, scale, floor, tuple(dict.fromkeys(omissions)))


def _references(
    task: MethodTask, problem: str, entries: Sequence[SettingRuns], worker: Worker, end: float
) -> tuple[list[ReferenceRun], list[str]]:
    """Compute up to `NEEDED` references; return them and the omissions."""
    references: list[ReferenceRun] = []
    omissions = []
    for method in REFERENCES[problem]:
        if len(references) == NEEDED or method.refuses(task.circuit):
            continue
        time = _instants(entries, references)
        try:
            limit = SHARE * (end - clock.perf_counter())
            u = worker.call(limit, method.compute, task, time)
            references.append(ReferenceRun(method.name, method.solver, time, u))
        except (TimeoutError, *FAILURES) as error:
            omissions.append(f"reference of the {problem}, {method.name}: {error}")
    return references, omissions


def _instants(entries: Sequence[SettingRuns], references: Sequence[ReferenceRun]) -> Floats:
    """Return all instants, or for the second reference those of runs by the first one's solver."""
    solver = references[0].solver if references else ""
    runs = [e.run.time for e in entries if e.run and (not solver or e.method.solver == solver)]
    if not references:
        return np.unique(np.concatenate([[0.0], *runs]))
    time = references[0].time
    return np.unique(np.concatenate(runs)) if runs else time[:: max(len(time) // COMPARED, 1)]


def _floor(references: Sequence[ReferenceRun], scale: ErrorScale) -> Errors:
    """Return the difference of the first reference to the second one, None without a second."""
    floor: Errors = dict.fromkeys(NORMS)
    if len(references) > 1:
        best, second = references
        difference = np.abs(second.u - best.at(second.time)) / scale.amplitude
        floor["maximum"], floor["final"] = float(difference.max()), float(difference[-1].max())
    return floor


def _board_target(task: MethodTask) -> Floats:
    """Return the outputs at the board's equilibrium, shape (N,), V."""
    rest = LinearBoard(task.circuit).equilibrium
    return np.array([out.sign * rest[out.node] for out in task.circuit.outputs])


def _ideal_target(task: MethodTask) -> Floats:
    """Return the outputs of the ideal network at rest, shape (N,), V."""
    return np.asarray(solve(task.network.problem).u * task.network.U0)
