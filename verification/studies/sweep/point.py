"""One point of a study, where it runs: a verification, and what is kept of it as plain data.

Nothing is raised across the border between processes: whatever happens at a point is its result.
"""

from __future__ import annotations

import io
import traceback
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from netlist_gen.problem.inverse_problem import InverseProblem
from netlist_gen.scene.scene import Scene
from spice_models.errors import TactionError
from verification.measures.settling import ChannelState
from verification.pipeline.effort import Effort
from verification.studies.figures import FIGURES, figures_of, finite
from verification.studies.running.versions import Versions
from verification.studies.sweep.store import ERROR
from verification.verify import Verdict, verify

POINT = Effort(details=False, full_margin=False, session=True)
LONGEST = 4000  # characters of a reason
STATES = tuple(ChannelState)  # the best first; of several channels the worst state counts


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A point to compute.

    Attributes
    ----------
    scene : Scene
        With the point's values and its engine.
    problem : InverseProblem
        Of that scene: its files may not be where the point runs.
    second_look : bool
        As `verification.pipeline.effort.Effort` has it.
    keep_waveforms : bool
        Whether the outputs over time are wanted.
    versions : Versions
        Of who asks.
    """

    scene: Scene
    problem: InverseProblem
    second_look: bool
    keep_waveforms: bool
    versions: Versions


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What came out of a job."""

    outcome: str
    record: dict[str, Any]
    waveforms: bytes | None = None


def compute(job: Job) -> Result:
    """Compute a point; never raises what could be a result.

    Raises
    ------
    OtherVersionsError
        This is no process that should compute it.
    """
    job.versions.check_here()
    try:
        verdict = verify(
            job.scene,
            problem=job.problem,
            effort=replace(POINT, second_look=job.second_look),
        )
        waveforms = _pack(verdict) if job.keep_waveforms else None
        return Result(verdict.outcome.value, verdict_record(verdict), waveforms)
    except TactionError as error:
        return failure(type(error).__name__, str(error), job.scene.analysis.engine)
    except Exception as error:  # a bug at one point must not be the end of ten thousand
        where = "".join(traceback.format_exception(error)[-2:]).strip()
        return failure(type(error).__name__, f"unforeseen: {where}", job.scene.analysis.engine)


def failure(kind: str, reason: str, engine: str) -> Result:
    """Return the result of a point that reached no verdict."""
    record: dict[str, Any] = {"outcome": ERROR, "failure": kind, "reason": reason[:LONGEST]}
    record |= {"engine": engine, "simulator": None, "state": None, "stable": None}
    return Result(ERROR, record | dict.fromkeys(FIGURES) | {"checks": []})


def verdict_record(verdict: Verdict) -> dict[str, Any]:
    """Return what a sweep keeps of a verdict: its figures, in words why it does not pass."""
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


def _pack(verdict: Verdict) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, time=np.asarray(verdict.waveforms.time), u=verdict.u)
    return buffer.getvalue()
