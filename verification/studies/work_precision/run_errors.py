"""Measures the runs of a work-precision study against references by other solvers."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from spice_models.array_types import Floats
from verification.engines.statespace.linearised.board import LinearBoard
from verification.reference import solve
from verification.studies.running.worker import FAILURES, Worker
from verification.studies.work_precision.ladders import SettingRuns
from verification.studies.work_precision.method_runs import Task
from verification.studies.work_precision.norms import (
    NORMS,
    Errors,
    Scale,
    make_scale,
    measure_errors,
)
from verification.studies.work_precision.references import NEEDED, REFERENCES, Reference

SHARE = 0.6  # of the time left that one reference may take
CHECKED = 500  # instants at which the references are compared where no run needs the second one


@dataclass(frozen=True, slots=True, eq=False)
class ProblemErrors:
    """What became of the runs of one problem.

    Attributes
    ----------
    errors : dict
        Errors by norm and the name of the reference, by method's name and setting.
    references : tuple of str
        Names, the preferred one first.
    scale : Scale or None
        What errors are measured by; None where there is no reference.
    floor : dict of str to float or None
        Error of the preferred reference: its difference to the second one. None where it is not
        known.
    omissions : tuple of str
        What could not be measured.
    """

    errors: Mapping[tuple[str, float], tuple[Errors, str]] = field(default_factory=dict)
    references: tuple[str, ...] = ()
    scale: Scale | None = None
    floor: Errors = field(default_factory=lambda: dict.fromkeys(NORMS))
    omissions: tuple[str, ...] = ()


def judge_runs(
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
        What the references may take.
    """
    end, found = clock.perf_counter() + seconds, {}
    for problem, ringing in (("ideal", None), ("board", pole)):  # an ideal network never rings
        done = [t for t in entries if t.method.problem == problem and t.run is not None]
        target = _board_target(task) if problem == "board" else _ideal_target(task)
        found[problem] = _judge(task, problem, done, target, band, ringing, worker, end)
    return {problem: found[problem] for problem in ("board", "ideal")}


def _judge(
    task: Task,
    problem: str,
    done: Sequence[SettingRuns],
    target: Floats,
    band: float,
    pole: complex | None,
    worker: Worker,
    end: float,
) -> ProblemErrors:
    runs = [entry.run for entry in done if entry.run is not None]
    if not runs:
        return ProblemErrors()
    time = np.unique(np.concatenate([[0.0], *(run.time for run in runs)]))
    references: list[tuple[Floats, Reference]] = []
    omissions = []
    for refuses, make in REFERENCES[problem]:
        if len(references) == NEEDED:
            break
        if refuses(task.circuit):
            continue
        wanted = _needed(time, done, references)
        try:
            left = SHARE * (end - clock.perf_counter())
            references.append((wanted, worker.call(left, make, task, wanted)))
        except (TimeoutError, *FAILURES) as error:
            omissions.append(f"reference {make.__name__} of the {problem}: {error}")
    if not references:
        return ProblemErrors(omissions=(*omissions, f"{problem}: no errors without a reference"))
    time, best = references[0]
    shown = max(runs, key=lambda run: len(run.time)).time  # the union of all has needless clusters
    shape = best.u[np.searchsorted(time, shown)]
    scale = make_scale(shown, shape, best.u[0], target, band, pole)
    errors = {}
    for entry in done:
        other = [(t, r) for t, r in references if r.solver != entry.method.solver]
        if entry.run is not None and other:
            at, reference = other[0]
            u = reference.u[np.searchsorted(at, entry.run.time)]
            measured = measure_errors(entry.run, u, scale)
            errors[entry.method.name, entry.setting] = measured, reference.name
        else:
            omissions.append(f"{entry.method.name}: no reference by another solver")
    names = tuple(reference.name for _, reference in references)
    return ProblemErrors(
        errors, names, scale, _floor(references, scale), tuple(dict.fromkeys(omissions))
    )


def _needed(
    time: Floats, done: Sequence[SettingRuns], references: Sequence[tuple[Floats, Reference]]
) -> Floats:
    """Instants of the next reference: all, or those of the runs that the first cannot judge."""
    if not references:
        return time
    own = references[0][1].solver
    runs = [t.run.time for t in done if t.run is not None and t.method.solver == own]
    return np.unique(np.concatenate(runs)) if runs else time[:: max(len(time) // CHECKED, 1)]


def _floor(references: Sequence[tuple[Floats, Reference]], scale: Scale) -> Errors:
    """Return what is known of the first reference's own errors."""
    floor: Errors = dict.fromkeys(NORMS)
    time, best = references[0]
    if len(references) > 1:
        at, second = references[1]
        apart = np.abs(second.u - best.u[np.searchsorted(time, at)]) / scale.amplitude
        floor["maximum"], floor["final"] = float(apart.max()), float(apart[-1].max())
    return floor


def _board_target(task: Task) -> Floats:
    """Return the outputs at the board's equilibrium, shape (N,), V."""
    rest = LinearBoard(task.circuit).equilibrium
    return np.array([out.sign * rest[out.node] for out in task.circuit.outputs])


def _ideal_target(task: Task) -> Floats:
    """Return the outputs of the ideal network at rest, shape (N,), V."""
    return np.asarray(solve(task.network.problem).u * task.network.U0)
