"""Norms of the difference between a record and its reference.

With the step amplitude A and the ringing mode p (the slowest decaying, or fastest growing, of the
oscillating modes that the step excites, as fitted to the reference at the same instants):

- ``final``: largest difference of any output at the end of the record, over A;
- ``maximum``: largest difference of any output at any recorded instant, over A;
- ``settling_time``: difference of the settling times over the reference's, both read from the same
  instants;
- ``frequency``: fitted frequency against ``|Im p| / 2 pi``, relative;
- ``growth_rate``: fitted growth rate minus ``Re p``, over ``|p|`` (not over Re p, which is 0 at the
  onset of oscillation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.readings.mode_fit import fit_modes
from taction.verification.readings.readings import settling_times
from taction.verification.readings.signals import FEWEST_POINTS, SampledSignal
from taction.verification.studies.work_precision.method_runs import MethodRun

NORMS = ("final", "maximum", "settling_time", "frequency", "growth_rate")
MARGIN = 1.25  # band over the largest deviation in the last part of the record
LAST = 0.8  # start of the last part, fraction of the record
OTHER_MODE = 0.2  # relative distance of a fitted pole that belongs to another mode

Errors = dict[str, float | None]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorScale:
    """Properties of the reference on which the norms depend."""

    target: Floats  # equilibrium, (N,), V
    amplitude: float  # step amplitude A, V
    band: float  # half width of the settling band, fraction of A
    settling_time: float | None  # s; None: not settled in the record
    ringing: complex | None  # fitted mode, 1/s; None: no mode rings long enough


def make_scale(
    time: Floats, u: Floats, start: Floats, target: Floats, band: float, pole: complex | None
) -> ErrorScale:
    """Return the scale of a reference record, with a wider band if the record is too short.

    Parameters
    ----------
    time, u : ndarray (P,) and (P, N)
        Reference record, s and V.
    start, target : ndarray (N,)
        Outputs just after the step and at the equilibrium, V.
    band : float
        Settling band of the scene, fraction of the step amplitude.
    pole : complex or None
        Pole of the linearised board that rings longest, 1/s.
    """
    amplitude = float(np.abs(target - start).max()) or 1.0
    late = np.abs(u[time >= LAST * time[-1]] - target).max() / amplitude
    if late > band:
        band = float(f"{MARGIN * late:.2g}")
    settling = settling_time(time, u, target, band * amplitude)
    return ErrorScale(target, amplitude, band, settling, fit_ringing(time, u, pole))


def settling_time(time: Floats, u: Floats, target: Floats, tolerance: float) -> float | None:
    """Return the settling time of the slowest channel, s; None if a channel does not settle."""
    if len(time) < FEWEST_POINTS:
        return None
    readings = settling_times(SampledSignal(time, (u - target).T), tolerance)
    times = [reading.value for reading in readings if reading is not None]
    return max(times) if len(times) == len(readings) else None


def fit_ringing(time: Floats, u: Floats, expected: complex | None) -> complex | None:
    """Return the fitted mode of a record nearest to `expected`, 1/s, or None if it is too far."""
    if expected is None:
        return None
    fitted = [
        complex(mode.growth_rate, 2 * math.pi * mode.frequency)
        for mode in fit_modes(time, u)
        if mode.frequency > 0
    ]
    nearest = min(fitted, key=lambda p: abs(p - expected), default=None)
    if nearest is None or abs(nearest - expected) > OTHER_MODE * abs(expected):
        return None
    return nearest


def measure_errors(run: MethodRun, reference: Floats, scale: ErrorScale) -> Errors:
    """Return the errors of a run by norm, None where a norm does not apply.

    `reference` holds the outputs of the reference at the instants of the run, (P, N), V.
    """
    difference = np.abs(run.u - reference) / scale.amplitude
    settling, expected_settling = (
        settling_time(run.time, u, scale.target, scale.band * scale.amplitude)
        for u in (run.u, reference)
    )
    errors: Errors = dict.fromkeys(NORMS)
    errors |= {"final": float(difference[-1].max()), "maximum": float(difference.max())}
    if settling and expected_settling:
        errors["settling_time"] = abs(settling / expected_settling - 1.0)
    mode, expected = (fit_ringing(run.time, u, scale.ringing) for u in (run.u, reference))
    if mode is not None and expected is not None:
        errors["frequency"] = abs(mode.imag / expected.imag - 1.0)
        errors["growth_rate"] = abs(mode.real - expected.real) / abs(expected)
    return errors
