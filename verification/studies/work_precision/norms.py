"""How far a record is from its reference, in named norms.

With the step amplitude A and the ringing mode p (the slowest decaying, or fastest growing, of the
oscillating modes that the step shows, as fitted to the reference at the same instants):

- ``final``: largest difference of any output at the end of the record, over A;
- ``maximum``: largest difference of any output at any recorded instant, over A;
- ``settling_time``: difference of the settling times over the reference's, both read from the same
  instants;
- ``frequency``: fitted frequency against ``|Im p| / 2 pi``, relative;
- ``growth_rate``: fitted growth rate minus ``Re p``, over ``|p|`` (relative to Re p itself it would
  say nothing on the edge of oscillation, where Re p is 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from verification.measures.mode_fit import fit_modes
from verification.measures.readings import settling_times
from verification.measures.sampled_signal import FEWEST_POINTS, SampledSignal
from verification.studies.work_precision.method_runs import MethodRun

NORMS = ("final", "maximum", "settling_time", "frequency", "growth_rate")
MARGIN = 1.25  # of what is left at the end of the record: the narrowest band that settles in it
LAST = 0.8  # of the record: what happens later does not widen the band
RIVAL = 0.2  # relative distance of the fitted pole beyond which it is another mode

Errors = dict[str, float | None]


@dataclass(frozen=True, slots=True, eq=False)
class Scale:
    """What the errors are measured by.

    Attributes
    ----------
    target : ndarray (N,)
        Equilibrium, V.
    amplitude : float
        Step amplitude A, V.
    band : float
        Half width of the settling band, fraction of A.
    settling_time : float or None
        The reference's, s; None where it does not settle in the record.
    ringing : complex or None
        Mode fitted to the reference, 1/s; None where nothing rings long enough.
    """

    target: Floats
    amplitude: float
    band: float
    settling_time: float | None
    ringing: complex | None


def make_scale(
    time: Floats, u: Floats, start: Floats, target: Floats, band: float, pole: complex | None
) -> Scale:
    """Take the scale from the reference record.

    The scene's band, or a wider one where the record is too short to settle to it.

    Parameters
    ----------
    time, u : ndarray (P,) and (P, N)
        Reference record, s and V.
    start, target : ndarray (N,)
        Outputs just after the step and at the equilibrium, V.
    band : float
        The scene's, fraction of the step amplitude.
    pole : complex or None
        Of the linearised board, the one that rings longest, 1/s.
    """
    amplitude = float(np.abs(target - start).max()) or 1.0
    late = np.abs(u[time >= LAST * time[-1]] - target).max() / amplitude
    if late > band:
        band = float(f"{MARGIN * late:.2g}")
    found = settling_time(time, u, target, band * amplitude)
    return Scale(target, amplitude, band, found, fit_ringing(time, u, pole))


def settling_time(time: Floats, u: Floats, target: Floats, tolerance: float) -> float | None:
    """Return when the last channel entered its band for good, s; None if one did not."""
    if len(time) < FEWEST_POINTS:
        return None
    found = settling_times(SampledSignal(time, (u - target).T), tolerance)
    times = [reading.value for reading in found if reading is not None]
    return max(times) if len(times) == len(found) else None


def fit_ringing(time: Floats, u: Floats, expected: complex | None) -> complex | None:
    """Fit the modes of a record; return the one nearest to `expected`, 1/s, if it is there."""
    if expected is None:
        return None
    fitted = [
        complex(mode.growth_rate, 2 * math.pi * mode.frequency)
        for mode in fit_modes(time, u)
        if mode.frequency > 0
    ]
    nearest = min(fitted, key=lambda p: abs(p - expected), default=None)
    if nearest is None or abs(nearest - expected) > RIVAL * abs(expected):
        return None
    return nearest


def ringing_errors(found: complex | None, expected: complex | None) -> tuple[float, float] | None:
    """Return the errors of frequency and growth rate, where both modes are there."""
    if found is None or expected is None:
        return None
    return abs(found.imag / expected.imag - 1.0), abs(found.real - expected.real) / abs(expected)


def measure_errors(run: MethodRun, reference: Floats, scale: Scale) -> Errors:
    """Compare a run with its reference at the same instants.

    Parameters
    ----------
    run : MethodRun
        What is judged.
    reference : ndarray (P, N)
        V.
    scale : Scale
        What to measure by.

    Returns
    -------
    dict of str to float or None
        One entry a norm; None where the norm does not apply.
    """
    difference = np.abs(run.u - reference) / scale.amplitude
    settled, proper = (
        settling_time(run.time, u, scale.target, scale.band * scale.amplitude)
        for u in (run.u, reference)
    )
    found, expected = (fit_ringing(run.time, u, scale.ringing) for u in (run.u, reference))
    ringing = ringing_errors(found, expected)
    return {
        "final": float(difference[-1].max()),
        "maximum": float(difference.max()),
        "settling_time": abs(settled / proper - 1.0) if settled and proper else None,
        "frequency": None if ringing is None else ringing[0],
        "growth_rate": None if ringing is None else ringing[1],
    }
