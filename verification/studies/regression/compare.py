"""Compare the results of one scene with its baseline, quantity by quantity."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taction.netlist_gen.scene.checks import Regression, WaveformTolerance
from taction.system.array_types import Floats
from taction.verification.readings.signals import lagrange
from taction.verification.studies.regression.baseline import (
    ALWAYS,
    CHANNEL_ALWAYS,
    CHANNEL_STABLE,
    STABLE,
    Entry,
    Observation,
)
from taction.verification.verdict.compare import (
    Difference,
    Tolerance,
    compare,
    numbers,
    relative,
    words,
)
from taction.verification.verdict.record import POLE_READINGS, Figure

STENCIL = 4  # cubic interpolation: error 1e-7 of the amplitude at 125 points on a ringing period


def compare_entry(now: Observation, then: Entry, allowed: Regression) -> tuple[Difference, ...]:
    """Compare a scene's results with its entry in the baseline, which is the first of both.

    Every quantity of either is compared, except checks that only one of them ran; of a board that
    became stable or unstable only the poles.
    """
    entry, tolerance = now.entry, scene_tolerance(allowed, then)
    same = entry.stable == then.stable
    found = compare(
        then.record,
        entry.record,
        tolerance,
        groups=("checks", "states", "figures") + ("channels",) * same,
        figures=(*ALWAYS[1:], *STABLE * same),
        channel_figures=CHANNEL_ALWAYS + CHANNEL_STABLE,
    )
    common = then.checks.keys() & entry.checks.keys()
    differences = [each for each in found if each.group != "checks" or each.name in common]
    if same:
        stops = Figure(then.stop, "s"), Figure(entry.stop, "s")
        differences.append(numbers("figures", "record", None, *stops, tolerance))
        differences += _waveforms(now, then, allowed.waveforms)
    return tuple(differences)


def scene_tolerance(allowed: Regression, then: Entry) -> Tolerance:
    """Return the tolerances of a scene.

    An absolute tolerance of a voltage counts in step amplitudes, one of a pole in its magnitude.
    """
    amplitude = then.record.value("step_amplitude") or 0.0

    def tolerance(name: str, first: Figure, second: Figure) -> float | None:
        size, unit = abs(first.value or 0.0), first.unit
        if name in POLE_READINGS:
            scale = then.speed if unit else 1.0
            return allowed.poles.absolute * scale + allowed.poles.relative * size
        if unit == "s":
            return allowed.times.absolute + allowed.times.relative * size
        scale = amplitude if unit == "V" else 1.0
        return allowed.levels.absolute * scale + allowed.levels.relative * size

    return tolerance


def _waveforms(now: Observation, then: Entry, allowed: WaveformTolerance) -> Iterator[Difference]:
    """Compare the outputs at the baseline's instants by interpolation of the record."""
    if not then.outputs or not now.entry.outputs:
        return
    common = [k for k, t in enumerate(then.time) if now.time[0] <= t <= now.time[-1]]
    at = np.array(then.time)[common]
    u = lagrange(now.time, now.u, at, STENCIL)
    new = dict(zip(now.entry.outputs, u.T, strict=True))
    amplitude = then.record.value("step_amplitude") or 0.0
    for name in {**then.outputs, **now.entry.outputs}:
        if name in new and name in then.outputs and len(common) > 1:
            old = np.array(then.outputs[name])[common]
            yield _waveform(name, at, new[name], old, allowed, amplitude)
        else:
            sides = ["there" if name in side else None for side in (then.outputs, new)]
            missing = words("waveforms", name, None, *sides)
            yield missing if missing.beyond else _incomparable(name)


def _incomparable(name: str) -> Difference:
    note = "the records have no instants in common"
    return Difference("waveforms", name, None, "there", "there", "", None, None, math.inf, note)


def _waveform(
    name: str,
    time: Floats,
    new: Floats,
    old: Floats,
    allowed: WaveformTolerance,
    amplitude: float,
) -> Difference:
    """Return the norms of both outputs, and that of their difference over what is allowed."""
    size, distance = _norm(allowed, time, old), _norm(allowed, time, new - old)
    tolerance = allowed.absolute * amplitude + allowed.relative * size
    apart = np.abs(new - old)
    worst = int(np.argmax(apart))
    note = f"{allowed.norm} norm; {apart[worst]:.3g} V apart at {time[worst]:.4g} s"
    norms = size, _norm(allowed, time, new)
    off = relative(distance, tolerance)
    return Difference("waveforms", name, None, *norms, "V", distance, tolerance, off, note)


def _norm(allowed: WaveformTolerance, time: Floats, u: Floats) -> float:
    if allowed.norm == "max":
        return float(np.max(np.abs(u)))
    square = u * u
    area = float(np.sum(0.5 * (square[1:] + square[:-1]) * np.diff(time)))
    return math.sqrt(area / float(time[-1] - time[0]))
