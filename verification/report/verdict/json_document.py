"""A verdict as one JSON document in SI base units."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from verification.measures.measurements import ChannelMeasure
from verification.pipeline.checks import Check
from verification.studies.figures import CHANNEL_FIGURES, FIGURES, figures_of
from verification.verify import Verdict

ERRORS = ("steady_state", "settling_time", "rise_time", "overshoot", "undershoot")


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict` as plain data: dicts, lists, numbers, strings (see the guide's section)."""
    figures, cost = figures_of(verdict, FIGURES), verdict.waveforms.cost
    return {
        "scene": verdict.scene.name,
        "file": str(verdict.scene.file),
        "outcome": verdict.outcome.value,
        "checks": [check_record(check) for check in verdict.checks],
        "channels": [
            channel_record(channel) | {"equilibrium": volts}
            for channel, volts in zip(
                verdict.measurements.channels, verdict.steady.values.tolist(), strict=True
            )
        ],
        "steady_state": {
            "equilibrium": figures["steady_state_error"],
            "record_end": figures["end_error"],
        },
        "step_amplitude": figures["step_amplitude"],
        "settling_time": figures["settling_time"],
        "settling_time_ideal": verdict.ideal.transient.settling_time,
        "stability": {
            "stable": verdict.poles.stable,
            "rightmost_pole": [verdict.poles.rightmost.real, verdict.poles.rightmost.imag],
            "damping_ratio": figures["damping_ratio"],
            "frequency": verdict.poles.frequency,
            "states": len(verdict.poles.poles) if verdict.poles.complete else None,
            "margin": figures["margin"],
        },
        "energy": {
            "identity_residual": verdict.ideal.transient.energy_residual,
            "rise": verdict.energy and verdict.energy.rise,
            "rise_time": verdict.energy and verdict.energy.time,
        },
        "constraint_plane": None if verdict.constraint is None else asdict(verdict.constraint),
        "error_budget": {
            part.name: {"value": part.value, "unit": "V", "how": part.how}
            for part in verdict.budget
        },
        "simulation_error": {name: getattr(verdict.error, name) for name in ERRORS},
        "accuracy": asdict(verdict.accuracy),
        "lambda": figures["lambda"],
        "lambda_rule": verdict.scene.lambda_rule or None,
        "resistance": figures["resistance"],
        "certificate": {
            "kind": verdict.ideal.solution.certificate_kind,
            "value": verdict.ideal.solution.certificate,
            "bound": verdict.ideal.solution.bound,
        },
        "engine": verdict.waveforms.engine.split("-")[0],
        "simulator": verdict.waveforms.engine,
        "simulation": {
            "stop": verdict.transient.stop,
            "max_step": verdict.waveforms.spacing,
            "points": cost.points,
            "seconds": cost.seconds,
        },
        "omissions": [{"what": o.what, "why": o.why} for o in verdict.circuit.omissions],
        "warnings": list(verdict.warnings),
        "timing": verdict.timing,
    }


def check_record(check: Check) -> dict[str, Any]:
    """Return one check as plain data."""
    return asdict(check) | {"outcome": check.outcome.value}


def channel_record(channel: ChannelMeasure) -> dict[str, Any]:
    """Return one channel as plain data; `index` counts from 1, as the node names do."""
    fragile = [r for r in (channel.rise_time, channel.settling_time) if r is not None and r.fragile]
    figures = figures_of(channel, CHANNEL_FIGURES)
    return {
        "index": channel.index + 1,
        "reference": figures.pop("target"),
        **figures,
        "state": channel.state.value,
        "fragile": bool(fragile),
        "alternatives": [r.alternative for r in fragile],
        "reason": channel.reason or channel.rise_reason,
    }
