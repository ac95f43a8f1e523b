"""Compare the results of one scene with its baseline, quantity by quantity."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from taction.netlist_gen.scene.regression import (
    LevelTolerance,
    PoleTolerance,
    Regression,
    TimeTolerance,
    WaveformTolerance,
)
from taction.system.array_types import Floats
from taction.verification.readings.resampling import lagrange
from taction.verification.studies.figures import CHANNEL_FIGURES, FIGURES
from taction.verification.studies.regression.baseline import Entry
from taction.verification.studies.regression.baseline_entry import Observation

STENCIL = 4  # cubic interpolation: error 1e-7 of the amplitude at 125 points on a ringing period
UNITS = {name: figure.unit for name, figure in (FIGURES | CHANNEL_FIGURES).items()}


@dataclass(frozen=True, slots=True)
class Difference:
    """One quantity and its baseline; of a waveform, the norms of both."""

    group: str  # "checks", "states", "levels", "times", "poles" or "waveforms"
    name: str
    value: float | str | None
    baseline: float | str | None
    tolerance: float | None  # allowed difference; None where the values must be equal
    off: float  # difference over tolerance; infinite where the values cannot be compared
    unit: str = ""  # SI, "step" for step amplitudes, or empty
    note: str = ""  # of a waveform: where the difference is largest

    @property
    def changed(self) -> bool:
        """Whether the difference is larger than the tolerance."""
        return not self.off <= 1.0


def compare(now: Observation, then: Entry, allowed: Regression) -> tuple[Difference, ...]:
    """Compare a scene's results with its entry in the baseline.

    Every quantity of either is compared, except checks that only one of them ran.
    """
    entry = now.entry
    common = [name for name in then.checks if name in entry.checks]
    differences = [_equal("checks", name, entry.checks[name], then.checks[name]) for name in common]
    for name in _names(entry.states, then.states):
        differences.append(_equal("states", name, entry.states.get(name), then.states.get(name)))
    differences += _numbers("poles", entry.poles, then.poles, allowed.poles, then.speed)
    if entry.stable == then.stable:  # an unstable board has no other quantities
        scale = then.amplitude
        differences += _numbers("levels", entry.levels, then.levels, allowed.levels, scale)
        differences += _times(entry, then, allowed.times)
        differences += _waveforms(now, then, allowed.waveforms)
    return tuple(differences)


def _names(now: Mapping[str, object], then: Mapping[str, object]) -> list[str]:
    return list(then) + [name for name in now if name not in then]


def _equal(group: str, name: str, value: str | None, baseline: str | None) -> Difference:
    return Difference(group, name, value, baseline, None, 0.0 if value == baseline else math.inf)


def _numbers(
    group: str,
    now: Mapping[str, float],
    then: Mapping[str, float],
    allowed: LevelTolerance | PoleTolerance,
    scale: float,
) -> Iterator[Difference]:
    """Compare numbers; the absolute tolerance is a fraction of `scale`, except for ratios."""
    for name in _names(now, then):
        unit = UNITS.get(name.rpartition(".")[2]) or "ratio"
        absolute = allowed.absolute * (1.0 if unit in ("step", "ratio") else scale)
        yield _number(group, name, now.get(name), then.get(name), allowed.relative, absolute, unit)


def _number(
    group: str,
    name: str,
    value: float | None,
    baseline: float | None,
    relative: float,
    absolute: float,
    unit: str,
) -> Difference:
    if value is None or baseline is None:
        off = 0.0 if value is baseline else math.inf
        return Difference(group, name, value, baseline, None, off, unit)
    tolerance = absolute + relative * abs(baseline)
    off = _in_tolerances(abs(value - baseline), tolerance)
    return Difference(group, name, value, baseline, tolerance, off, unit)


def _in_tolerances(distance: float, tolerance: float) -> float:
    if distance == 0.0:
        return 0.0
    return distance / tolerance if tolerance > 0.0 else math.inf


def _times(entry: Entry, then: Entry, allowed: TimeTolerance) -> Iterator[Difference]:
    """Compare times; of a fragile time, the nearest value counts."""
    for name in _names(entry.times, then.times):
        pairs = product(entry.times.get(name, [None]), then.times.get(name, [None]))
        tolerance = (allowed.relative, allowed.absolute, "s")
        differences = [_number("times", name, value, old, *tolerance) for value, old in pairs]
        yield min(differences, key=lambda difference: difference.off)


def _waveforms(now: Observation, then: Entry, allowed: WaveformTolerance) -> Iterator[Difference]:
    """Compare the outputs at the baseline's instants by interpolation of the record."""
    if not then.outputs or not now.entry.outputs:
        return
    common = [k for k, t in enumerate(then.time) if now.time[0] <= t <= now.time[-1]]
    at = np.array(then.time)[common]
    u = lagrange(now.time, now.u, at, STENCIL)
    new = dict(zip(now.entry.outputs, u.T, strict=True))
    for name in _names(now.entry.outputs, then.outputs):
        if name in new and name in then.outputs and len(common) > 1:
            old = np.array(then.outputs[name])[common]
            yield _waveform(name, at, new[name], old, allowed, then.amplitude)
        else:
            value, baseline = ("there" if name in side else None for side in (new, then.outputs))
            yield Difference("waveforms", name, value, baseline, None, math.inf)


def _waveform(
    name: str,
    time: Floats,
    new: Floats,
    old: Floats,
    allowed: WaveformTolerance,
    amplitude: float,
) -> Difference:
    size, distance = _norm(allowed, time, old), _norm(allowed, time, new - old)
    tolerance = allowed.absolute * amplitude + allowed.relative * size
    off = _in_tolerances(distance, tolerance)
    apart = np.abs(new - old)
    worst = int(np.argmax(apart))
    note = f"{allowed.norm} norm; {apart[worst]:.3g} V apart at {time[worst]:.4g} s"
    value = _norm(allowed, time, new)
    return Difference("waveforms", name, value, size, tolerance, off, "V", note)


def _norm(allowed: WaveformTolerance, time: Floats, u: Floats) -> float:
    if allowed.norm == "max":
        return float(np.max(np.abs(u)))
    square = u * u
    area = float(np.sum(0.5 * (square[1:] + square[:-1]) * np.diff(time)))
    return math.sqrt(area / float(time[-1] - time[0]))
