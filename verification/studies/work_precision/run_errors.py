"""Measure the runs of a work-precision study against references by other solvers."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.reference import solve
from taction.verification.studies.running.worker import FAILURES, Worker
from taction.verification.studies.work_precision.ladders import SettingRuns
from taction.verification.studies.work_precision.method_runs import Task
from taction.verification.studies.work_precision.norms import (
    NORMS,
    Errors,
    ErrorScale,
    make_scale,
    measure_errors,
)
from taction.verification.studies.work_precision.references import NEEDED, REFERENCES

SHARE = 0.6  # of the remaining time that one reference may take
COMPARED = 500  # instants of the second reference where no run needs it


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
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
    task: Task,
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
    task: Task,
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
    task: Task, problem: str, entries: Sequence[SettingRuns], worker: Worker, end: float
) -> tuple[list[Reference], list[str]]:
    """Compute up to `NEEDED` references; return them and the omissions."""
    references: list[Reference] = []
    omissions = []
    for method in REFERENCES[problem]:
        if len(references) == NEEDED or method.refuses(task.circuit):
            continue
        time = _instants(entries, references)
        try:
            limit = SHARE * (end - clock.perf_counter())
            u = worker.call(limit, method.compute, task, time)
            references.append(Reference(method.name, method.solver, time, u))
        except (TimeoutError, *FAILURES) as error:
            omissions.append(f"reference of the {problem}, {method.name}: {error}")
    return references, omissions


def _instants(entries: Sequence[SettingRuns], references: Sequence[Reference]) -> Floats:
    """Return all instants, or for the second reference those of runs by the first one's solver."""
    solver = references[0].solver if references else ""
    runs = [e.run.time for e in entries if e.run and (not solver or e.method.solver == solver)]
    if not references:
        return np.unique(np.concatenate([[0.0], *runs]))
    time = references[0].time
    return np.unique(np.concatenate(runs)) if runs else time[:: max(len(time) // COMPARED, 1)]


def _floor(references: Sequence[Reference], scale: ErrorScale) -> Errors:
    """Return the difference of the first reference to the second one, None without a second."""
    floor: Errors = dict.fromkeys(NORMS)
    if len(references) > 1:
        best, second = references
        difference = np.abs(second.u - best.at(second.time)) / scale.amplitude
        floor["maximum"], floor["final"] = float(difference.max()), float(difference[-1].max())
    return floor


def _board_target(task: Task) -> Floats:
    """Return the outputs at the board's equilibrium, shape (N,), V."""
    rest = LinearBoard(task.circuit).equilibrium
    return np.array([out.sign * rest[out.node] for out in task.circuit.outputs])


def _ideal_target(task: Task) -> Floats:
    """Return the outputs of the ideal network at rest, shape (N,), V."""
    return np.asarray(solve(task.network.problem).u * task.network.U0)
