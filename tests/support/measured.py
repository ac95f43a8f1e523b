"""Measurements, poles and evidence made by hand, for tests of what is concluded from them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from taction.netlist_gen.scene.check_keys import AGREE, Checks
from taction.system.array_types import EPS, Complexes, Cost, Waveforms
from taction.system.reading_definitions import READINGS
from taction.verification.engines.statespace.linearised.time_scales import TimeScales
from taction.verification.readings.measurements import ChannelMeasure, Measurements, summary
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import Poles
from taction.verification.verdict.board import SteadyState
from taction.verification.verdict.checks import Check, Evidence
from taction.verification.verdict.run import Agreement
from taction.verification.verdict.run_checks import run_checks
from taction.verification.verdict.verify import Verdict


def rounded_poles(values: Complexes) -> Poles:
    """Return all poles of a board, known to 64 units of rounding of the fastest."""
    values = values[np.lexsort((-values.imag, -values.real))]
    error = 64.0 * EPS * float(np.abs(values).max(initial=0.0))
    return Poles(values, np.full(len(values), error), complete=True)


ROUNDING = 1e-15  # an error is never 0
STABLE = rounded_poles(np.array([-1e3 + 1e5j, -1e3 - 1e5j]))
UNSTABLE = rounded_poles(np.array([1e3 + 1e5j, 1e3 - 1e5j]))


def channel(index: int = 0, **changes: Any) -> ChannelMeasure:
    """A settled channel that goes from 0 to 1 V, rises in 10 µs and settles in 1 ms.

    Changes by the name of a reading are readings, or numbers that only rounding makes uncertain.
    """
    readings = {
        "rise_time": Reading(10e-6, 1e-9),
        "settling_time": Reading(1e-3, 1e-7),
        "overshoot": Reading(0.1, ROUNDING),
        "undershoot": Reading(0.02, ROUNDING),
    }
    for name in READINGS.keys() & changes.keys():
        given = changes.pop(name)
        readings[name] = Reading(given, ROUNDING) if isinstance(given, float) else given
    made = ChannelMeasure(
        index=index,
        target=1.0,
        final=1.0,
        readings=readings,
        state=ChannelState.SETTLED,
        frequency=None,
        growth_rate=None,
        rises=True,
        reason="",
        rise_reason="",
    )
    return replace(made, **changes)


def oscillating(index: int = 0) -> ChannelMeasure:
    return channel(
        index,
        state=ChannelState.OSCILLATING,
        settling_time=None,
        frequency=4e4,
        growth_rate=1e3,
        reason="it oscillates",
    )


def measured(*channels: ChannelMeasure, **changes: Any) -> Measurements:
    """Measurements of the channels; the network settles with the last of them."""
    return replace(summary(1.0, 0.01, (), channels), **changes)


def evidence(
    *channels: ChannelMeasure,
    checks: dict[str, Any] | None = None,
    **changes: Any,
) -> Evidence:
    measurements = changes.pop("measurements", None) or measured(*(channels or (channel(),)))
    made = Evidence(
        limits=Checks.model_validate(checks or {}),
        measurements=measurements,
        end_error=ROUNDING,
        steady=steady(*(c.final for c in measurements.channels)),
        end=1.0,
        forever=False,
        wanted=2.5e-4,
        agreement=None,
        poles=STABLE,
        margin=None,
        reference_error=0.0,
        reference_problem="",
    )
    return replace(made, **changes)


def steady(
    *volts: float, error: float = ROUNDING, left: float = 0.0, linear: bool = True
) -> SteadyState:
    """Equilibrium outputs; a mode with a time constant of 1 s leaves `left` V at 1 s."""
    amplitudes, poles = np.array([left * math.e]), np.array([-1.0 + 0j])
    scales = TimeScales(poles, amplitudes, poles.real, (), math.inf, 0.0, 0.0, step=1.0)
    return SteadyState(np.array(volts), error, scales, linear)


def agreement(difference: float, step_error: float = 0.0, reason: str = "") -> Agreement:
    u = np.array([[difference]])
    wave = Waveforms(np.array([1e-6]), ("v_1",), 0.0 * u, "statespace", Cost(0.0, 1))
    return Agreement(
        wave.time, u, wave.values, wave, ROUNDING, reason, step_error=step_error, limit=AGREE
    )


def margin(factor: float, uncertainty: float = 0.0, doubt: str = "") -> Margin:
    return Margin(factor, uncertainty, f"C may shrink by {factor:g}", doubt)


def check(name: str, given: Evidence) -> Check:
    """Return the check `name` of all that `given` is judged by."""
    return next(found for found in run_checks(given) if found.name == name)


def named(verdict: Verdict, name: str) -> Check:
    """Return the check `name` of a verdict."""
    return next(check for check in verdict.checks if check.name == name)
