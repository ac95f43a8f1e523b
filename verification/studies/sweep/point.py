"""One point of a sweep in a worker process: a verification, reduced to plain data.

A failed verification is a result like any other: no exception crosses the border between processes.
"""

from __future__ import annotations

import io
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import MACHINE_FAILURES, TactionError
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.studies.figures import FIGURES, figures_of, finite, readings_of
from taction.verification.studies.running.repeating import repeated_if_killed
from taction.verification.studies.running.versions import Versions
from taction.verification.studies.sweep.store import ERROR, StoredResult
from taction.verification.verdict.effort import Effort
from taction.verification.verdict.verify import Verdict, verify

POINT_EFFORT = Effort(details=False)
MAX_REASON = 4000  # characters
STATES = tuple(ChannelState)  # the best first; of several channels the worst state counts


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A point to compute."""

    scene: Scene  # with the point's values and its engine
    problem: InverseProblem  # of `scene`, whose files may be missing on the worker's machine
    keep_waveforms: bool
    versions: Versions  # of the process that runs the sweep


def compute(job: Job) -> StoredResult:
    """Compute a point; a verification that fails gives a result, too.

    Raises
    ------
    OtherVersionsError
        This process has other versions of taction or ngspice than the job.
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        This machine can compute no point; the point itself may be right.
    """
    job.versions.check_here()
    try:
        verdict = repeated_if_killed(
            lambda: verify(job.scene, problem=job.problem, effort=POINT_EFFORT)
        )
        waveforms = _pack(verdict) if job.keep_waveforms else None
        return StoredResult(verdict.outcome.value, verdict_record(verdict), waveforms)
    except MACHINE_FAILURES:
        raise
    except TactionError as error:
        return failure(type(error).__name__, str(error), job.scene.analysis.engine)
    except Exception as error:  # a defect at one point must not end a sweep of ten thousand
        where = "".join(traceback.format_exception(error)[-2:]).strip()
        return failure(type(error).__name__, f"unforeseen: {where}", job.scene.analysis.engine)


def failure(kind: str, reason: str, engine: str) -> StoredResult:
    """Return the result of a point that reached no verdict."""
    record: dict[str, Any] = {"outcome": ERROR, "failure": kind, "reason": reason[:MAX_REASON]}
    record |= {"engine": engine, "simulator": None, "state": None, "stable": None}
    rest: dict[str, Any] = {
        "readings": {},
        "wanted_error": None,
        "attained_error": None,
        "checks": [],
    }
    return StoredResult(ERROR, record | dict.fromkeys(FIGURES) | rest)


def verdict_record(verdict: Verdict) -> dict[str, Any]:
    """Return the record of a verdict: its figures, and the reason where it does not pass."""
    decisive = next((c for c in verdict.checks if c.outcome is verdict.outcome), None)
    passed = verdict.outcome.value == "pass"
    engine = verdict.waveforms.engine
    return {
        "outcome": verdict.outcome.value,
        "failure": None,
        "reason": "" if passed or decisive is None else f"{decisive.name}: {decisive.reason}",
        "engine": engine.split("-")[0],
        "simulator": engine,
        "state": max((c.state for c in verdict.measurements.channels), key=STATES.index).value,
        "stable": verdict.poles.stable,
        **figures_of(verdict, FIGURES),
        "readings": {name: _reading(value) for name, value in readings_of(verdict).items()},
        "wanted_error": verdict.accuracy.wanted,
        "attained_error": finite(verdict.accuracy.achieved),
        "checks": [
            {
                "name": check.name,
                "outcome": check.outcome.value,
                "value": finite(check.value),
                "uncertainty": finite(check.uncertainty),
            }
            for check in verdict.checks
        ],
    }


def _reading(reading: Reading | None) -> dict[str, float | None] | None:
    if reading is None:
        return None
    names = ("value", "uncertainty", "alternative")
    return {name: finite(getattr(reading, name)) for name in names}


def _pack(verdict: Verdict) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, time=np.asarray(verdict.waveforms.time), u=verdict.u)
    return buffer.getvalue()
