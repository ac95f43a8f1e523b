"""A verdict as one JSON document in SI base units."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from taction.system.documents import plain
from taction.verification.report.verdict.scene_keys import scene_keys
from taction.verification.verdict.checks import Check
from taction.verification.verdict.error_budget import ErrorBudget, ErrorPart
from taction.verification.verdict.headroom import Load
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.record import Channel, Record, finite
from taction.verification.verdict.verify import Verdict


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict` as plain data: dicts, lists, numbers, strings (see the guide's section)."""
    record, cost = Record.of(verdict), verdict.waveforms.cost
    figures = record.figures
    return {
        "scene": verdict.scene.name,
        "file": str(verdict.scene.file),
        "outcome": verdict.outcome.value,
        "checks": [check_record(check) for check in verdict.checks],
        "channels": [channel_record(channel) for channel in record.channels],
        "steady_state": {
            "equilibrium": figures["steady_state_error"],
            "record_end": figures["end_error"],
        },
        "step_amplitude": figures["step_amplitude"],
        "step_amplitude_uncertainty": finite(verdict.ideal.error * verdict.measurements.amplitude),
        "settling_time": figures["settling_time"],
        "settling_time_ideal": verdict.ideal.transient.settling_time,
        "stability": {
            "stable": verdict.poles.stable,
            "rightmost_pole": [verdict.poles.rightmost.real, verdict.poles.rightmost.imag],
            "rightmost_pole_uncertainty": finite(verdict.poles.resolution),
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
        "error_budget": budget_record(verdict.budget),
        "opamp_level": "small-signal" if verdict.circuit.is_small_signal else "large-signal",
        "headroom": [
            load_record(load) for load in (*verdict.parts.simulated, *verdict.parts.worst)
        ],
        "noise": None if verdict.noise is None else noise_record(verdict.noise),
        "simulation_error": {"steady_state": verdict.error.steady_state, **verdict.error.readings},
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
        "solver": verdict.waveforms.solver or None,
        "method": verdict.waveforms.method or None,
        "simulation": {
            "stop": verdict.transient.stop,
            "max_step": verdict.waveforms.spacing,
            "points": cost.points,
            "seconds": cost.seconds,
        },
        "keys": scene_keys(verdict.scene),
        "omissions": [{"what": o.what, "why": o.why} for o in verdict.circuit.omissions],
        "warnings": list(verdict.warnings),
        "timing": verdict.timing,
    }


def budget_record(budget: ErrorBudget) -> dict[str, Any]:
    """Return the parts of an error budget by name, and ``total``, as plain data."""
    records = {part.name: _part_record(part) for part in budget}
    if budget.total is None:
        return records
    more = {"sum": list(budget.summed), "solves": budget.solves}
    return records | {"total": _part_record(budget.total) | more}


def _part_record(part: ErrorPart) -> dict[str, Any]:
    known = {"value": part.value, "unit": "V", "how": part.how, "bound": part.bound}
    return known | {"channels": list(part.channels), "predicted": list(part.predicted)}


def load_record(load: Load) -> dict[str, Any]:
    """Return one load of an op-amp as plain data."""
    at_rest = math.isinf(load.at)
    more = {"time": None if at_rest else load.at, "share": load.share, "unit": load.unit}
    names = ("part", "quantity", "peak", "limit", "rest", "error")
    return {name: getattr(load, name) for name in names} | more


def noise_record(noise: OutputNoise) -> dict[str, Any]:
    """Return the noise of the outputs as plain data, one value for each channel."""
    known = {"rms": list(noise.rms), "uncertainties": [finite(error) for error in noise.error]}
    return known | {"unit": "V", "ngspice": noise.simulated, "reason": noise.unknown}


def check_record(check: Check) -> dict[str, Any]:
    """Return one check as plain data."""
    return asdict(check) | {"outcome": check.outcome.value}


def channel_record(channel: Channel) -> dict[str, Any]:
    """Return one channel as plain data; `index` counts from 1, as the node names do."""
    made: dict[str, Any] = plain(channel)
    return made
