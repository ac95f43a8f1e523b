"""Points of a sweep in a worker process: verifications, reduced to plain data.

A failed verification is a result like any other: no exception crosses the border between processes.
"""

from __future__ import annotations

from taction.verification.studies.running.collecting import attempted
from taction.verification.studies.running.versions import check_version
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import Verdict
from taction.verification.verdict.verify_together import Request, verify_together


def compute(version: str, *jobs: Request | Record) -> list[Record | None]:
    """Compute points; a verification that fails gives a record, too, and a record is its own.

    Of several points those are computed that the engine solves together; each other one is None,
    and needs a call of its own. `version` is that of the process that runs the sweep.

    Raises
    ------
    OtherVersionsError
        This process has another version of taction or ngspice.
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        This machine can compute no point; the point itself may be right.
    """
    check_version(version)
    found = {place: job for place, job in enumerate(jobs) if isinstance(job, Record)}
    todo = {place: job for place, job in enumerate(jobs) if isinstance(job, Request)}
    if len(jobs) == 1:
        return [_computed(job) for job in todo.values()] or list(found.values())
    places = list(todo)
    found |= {places[k]: _result(each) for k, each in verify_together(list(todo.values()))}
    return [found.get(place) for place in range(len(jobs))]


def _result(verdict: Verdict) -> Record:
    return Record.of(verdict, channels=False)


def _computed(job: Request) -> Record:
    """Compute one point."""
    engine = job.scene.analysis.engine
    return attempted(
        lambda: _result(job.verdict()),
        lambda error, reason: Record.without_verdict(type(error).__name__, reason, engine),
    )
