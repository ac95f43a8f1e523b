"""One point of a study, where it runs: a verification, and what is kept of it as plain data.

Nothing is raised across the border between processes: whatever happens at a point is its result.
"""

from __future__ import annotations

import io
import math
import platform
import traceback
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from netlist_gen.problem.inverse_problem import InverseProblem
from netlist_gen.scene.scene import Scene
from spice_models.errors import TactionError
from verification.measures.settling import ChannelState
from verification.pipeline.effort import Effort
from verification.studies.running.versions import Versions, own_versions
from verification.studies.sweep.store import ERROR
from verification.verify import Verdict, verify

POINT = Effort(details=False, full_margin=False, session=True)
LONGEST = 4000  # characters of a reason
# Of several channels the worst state counts.
STATES = (
    ChannelState.DIVERGED,
    ChannelState.CLIPPED,
    ChannelState.OSCILLATING,
    ChannelState.NOT_SETTLED,
    ChannelState.UNDECIDED,
    ChannelState.SETTLED,
)
# The numbers of a record, in base units: name, unit. Every record has every one, or None.
NUMBERS = {
    "settling_time": "s",
    "rise_time": "s",
    "overshoot": "step",
    "steady_state_error": "step",
    "growth_rate": "1/s",
    "frequency": "Hz",
    "damping_ratio": "",
    "margin": "",
    "step_amplitude": "V",
    "lambda": "",
    "resistance": "ohm",
    "simulation_error": "step",
    "seconds": "s",
}


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
    """What came out of a job; `skew` names a worker that should not have computed it."""

    outcome: str
    record: dict[str, Any]
    waveforms: bytes | None = None
    skew: str = ""


def compute(job: Job) -> Result:
    """Compute a point; never raises what could be a result."""
    try:
        differences = job.versions.differences(own_versions(bool(job.versions.ngspice)))
        if differences:
            return Result(ERROR, {}, skew=f"{platform.node()} has {', '.join(differences)}")
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
    return Result(ERROR, record | dict.fromkeys(NUMBERS) | {"checks": []})


def verdict_record(verdict: Verdict) -> dict[str, Any]:
    """Return what a sweep keeps of a verdict; see `NUMBERS` for the units."""
    measured, poles, scalings = verdict.measurements, verdict.poles, verdict.circuit.scalings
    channels = measured.channels
    rises = [c.rise_time.value for c in channels if c.rise_time is not None]
    amplitude = measured.amplitude or math.nan
    undecided = next((c for c in verdict.checks if c.outcome is verdict.outcome), None)
    numbers = {
        "settling_time": None if measured.settling_time is None else measured.settling_time.value,
        "rise_time": max(rises, default=None),
        "overshoot": max(c.overshoot for c in channels),
        "steady_state_error": max(abs(c.final - c.target) for c in channels) / amplitude,
        "growth_rate": poles.rightmost.real,
        "frequency": abs(poles.rightmost.imag) / (2.0 * math.pi),
        "damping_ratio": poles.damping_ratio,
        "margin": None if verdict.margin is None else verdict.margin.factor,
        "step_amplitude": measured.amplitude,
        "lambda": scalings.lam,
        "resistance": scalings.resistance,
        "simulation_error": verdict.error.steady_state,
        "seconds": verdict.timing["total"],
    }
    engine = verdict.waveforms.engine
    passed = verdict.outcome.value == "pass"
    return {
        "outcome": verdict.outcome.value,
        "failure": None,
        "reason": "" if passed or undecided is None else f"{undecided.name}: {undecided.reason}",
        "engine": engine.split("-")[0],
        "simulator": engine,
        "state": min((c.state for c in channels), key=STATES.index).value,
        "stable": poles.stable,
        **{name: _finite(value) for name, value in numbers.items()},
        "checks": [
            {
                "name": check.name,
                "outcome": check.outcome.value,
                "value": _finite(check.value),
                "uncertainty": _finite(check.uncertainty),
            }
            for check in verdict.checks
        ],
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _pack(verdict: Verdict) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, time=np.asarray(verdict.waveforms.time), u=verdict.u)
    return buffer.getvalue()
