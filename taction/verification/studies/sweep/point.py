"""One point of a sweep in a worker process: a verification, reduced to plain data.

A failed verification is a result like any other: no exception crosses the border between processes.
"""

from __future__ import annotations

from dataclasses import dataclass

from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.studies.running.collecting import attempted
from taction.verification.studies.running.versions import check_version
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import Effort, Verdict, verify
from taction.verification.verdict.verify_together import Request, verify_together

POINT_EFFORT = Effort(details=False)


@dataclass(frozen=True, slots=True, eq=False)
class PointJob:
    """A point to compute."""

    scene: Scene  # with the point's values and its engine
    problem: InverseProblem  # of `scene`, whose files may be missing on the worker's machine
    version: str  # of the process that runs the sweep


def compute(*jobs: PointJob | Record) -> list[Record | None]:
    """Compute points; a verification that fails gives a record, too, and a record is its own.

    Of several points those are computed that the engine solves together; each other one is None,
    and needs a call of its own.

    Raises
    ------
    OtherVersionsError
        This process has another version of taction or ngspice than the job.
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        This machine can compute no point; the point itself may be right.
    """
    found = {place: job for place, job in enumerate(jobs) if isinstance(job, Record)}
    todo = {place: job for place, job in enumerate(jobs) if isinstance(job, PointJob)}
    for version in {job.version for job in todo.values()}:
        check_version(version)
    if len(jobs) == 1:
        return [_computed(job) for job in todo.values()] or list(found.values())
    requests = [Request(job.scene, job.problem, effort=POINT_EFFORT) for job in todo.values()]
    places = list(todo)
    found |= {places[k]: _result(each) for k, each in verify_together(requests)}
    return [found.get(place) for place in range(len(jobs))]


def _result(verdict: Verdict) -> Record:
    return Record.of(verdict, channels=False)


def _computed(job: PointJob) -> Record:
    """Compute one point."""
    engine = job.scene.analysis.engine
    return attempted(
        lambda: _result(verify(job.scene, problem=job.problem, effort=POINT_EFFORT)),
        lambda error, reason: Record.without_verdict(type(error).__name__, reason, engine),
    )
