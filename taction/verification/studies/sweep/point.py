"""One point of a sweep in a worker process: a verification, reduced to plain data.

A failed verification is a result like any other: no exception crosses the border between processes.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.studies.running.collecting import attempted
from taction.verification.studies.running.versions import Versions
from taction.verification.studies.store import StoredResult
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import Effort, Verdict, verify
from taction.verification.verdict.verify_together import Request, verify_together

POINT_EFFORT = Effort(details=False)


@dataclass(frozen=True, slots=True, eq=False)
class PointJob:
    """A point to compute."""

    scene: Scene  # with the point's values and its engine
    problem: InverseProblem  # of `scene`, whose files may be missing on the worker's machine
    keep_waveforms: bool
    versions: Versions  # of the process that runs the sweep


def compute(*jobs: PointJob) -> list[StoredResult | None]:
    """Compute points; a verification that fails gives a result, too.

    Of several points those are computed that the engine solves together; each other one is None,
    and needs a call of its own.

    Raises
    ------
    OtherVersionsError
        This process has other versions of taction or ngspice than the job.
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        This machine can compute no point; the point itself may be right.
    """
    for versions in {id(job.versions): job.versions for job in jobs}.values():
        versions.check_here()
    if len(jobs) == 1:
        return [_computed(jobs[0])]
    requests = [Request(job.scene, job.problem, effort=POINT_EFFORT) for job in jobs]
    found = {place: _result(jobs[place], each) for place, each in verify_together(requests)}
    return [found.get(place) for place in range(len(jobs))]


def _result(job: PointJob, verdict: Verdict) -> StoredResult:
    waveforms = _pack(verdict) if job.keep_waveforms else None
    return StoredResult.of(Record.of(verdict, channels=False), waveforms)


def _computed(job: PointJob) -> StoredResult:
    """Compute one point."""
    return attempted(
        lambda: _result(job, verify(job.scene, problem=job.problem, effort=POINT_EFFORT)),
        lambda error, reason: failure(error, reason, job.scene.analysis.engine),
    )


def failure(error: BaseException, reason: str, engine: str) -> StoredResult:
    """Return the result of a point that reached no verdict."""
    return StoredResult.of(Record.without_verdict(type(error).__name__, reason, engine))


def _pack(verdict: Verdict) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, time=np.asarray(verdict.waveforms.time), u=verdict.u)
    return buffer.getvalue()
