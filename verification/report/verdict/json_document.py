"""A verdict as one JSON document; SI base units throughout."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from verification.measures.measurements import ChannelMeasure
from verification.measures.readings import Reading
from verification.pipeline.checks import Check
from verification.verify import Verdict


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict` as plain data: dicts, lists, numbers, strings (see the guide's section)."""
    scalings, measurements = verdict.circuit.scalings, verdict.measurements
    cost = verdict.waveforms.cost
    return {
        "scene": verdict.scene.name,
        "file": str(verdict.scene.file),
        "outcome": verdict.outcome.value,
        "checks": [check_record(check) for check in verdict.checks],
        "channels": [channel_record(channel) for channel in measurements.channels],
        "step_amplitude": measurements.amplitude,
        "settling_time": reading_record(measurements.settling_time),
        "settling_time_ideal": verdict.ideal.pace.settling_time,
        "stability": {
            "stable": verdict.poles.stable,
            "rightmost_pole": [verdict.poles.rightmost.real, verdict.poles.rightmost.imag],
            "damping_ratio": verdict.poles.damping_ratio,
            "frequency": verdict.poles.frequency,
            "states": len(verdict.poles.poles) if verdict.poles.complete else None,
            "margin": None if verdict.margin is None else verdict.margin.factor,
        },
        "energy": {
            "identity_residual": verdict.ideal.pace.energy_residual,
            "rise": None if verdict.energy is None else verdict.energy.rise,
            "rise_time": None if verdict.energy is None else verdict.energy.time,
        },
        "constraint_plane": None if verdict.constraint is None else asdict(verdict.constraint),
        "error_budget": {
            part.name: {"value": part.value, "unit": "V", "how": part.how}
            for part in verdict.budget
        },
        "simulation_error": {
            "steady_state": verdict.error.steady_state,
            "settling_time": verdict.error.settling_time,
            "rise_time": verdict.error.rise_time,
            "overshoot": verdict.error.overshoot,
        },
        "accuracy": None if verdict.accuracy is None else asdict(verdict.accuracy),
        "lambda": scalings.lam,
        "lambda_rule": verdict.scene.lambda_rule or None,
        "resistance": scalings.resistance,
        "certificate": {
            "kind": verdict.ideal.solution.certificate_kind,
            "value": verdict.ideal.solution.certificate,
            "bound": verdict.ideal.solution.bound,
        },
        "engine": verdict.waveforms.engine.split("-")[0],
        "simulator": verdict.waveforms.engine,
        "simulation": {
            "stop": verdict.transient.stop,
            "max_step": verdict.transient.max_step,
            "points": cost.points,
            "seconds": cost.seconds,
        },
        "omissions": [{"what": o.what, "why": o.why} for o in verdict.circuit.omissions],
        "warnings": list(verdict.warnings),
        "timing": verdict.timing,
    }


def check_record(check: Check) -> dict[str, Any]:
    """Return one check as plain data."""
    return {
        "name": check.name,
        "outcome": check.outcome.value,
        "value": check.value,
        "uncertainty": check.uncertainty,
        "expected": check.expected,
        "tolerance": check.tolerance,
        "unit": check.unit,
        "reason": check.reason,
    }


def channel_record(channel: ChannelMeasure) -> dict[str, Any]:
    """Return one channel as plain data; `index` counts from 1, as the node names do."""
    fragile = [r for r in (channel.rise_time, channel.settling_time) if r is not None and r.fragile]
    return {
        "index": channel.index + 1,
        "reference": channel.target,
        "final": channel.final,
        "rise_time": reading_record(channel.rise_time),
        "settling_time": reading_record(channel.settling_time),
        "overshoot": channel.overshoot,
        "state": channel.state.value,
        "frequency": channel.frequency,
        "growth_rate": channel.growth_rate,
        "fragile": bool(fragile),
        "alternatives": [r.alternative for r in fragile],
        "reason": channel.reason or channel.rise_reason,
    }


def reading_record(reading: Reading | None) -> float | None:
    """Return a reading's value, or None."""
    return None if reading is None or not math.isfinite(reading.value) else reading.value
