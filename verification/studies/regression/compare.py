"""One scene's results against its baseline, measure by measure and signal by signal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from netlist_gen.scene.regression import (
    LevelTolerance,
    PoleTolerance,
    Regression,
    TimeTolerance,
    WaveformTolerance,
)
from spice_models.array_types import Floats
from verification.measures.resampling import lagrange
from verification.studies.figures import CHANNEL_FIGURES, FIGURES
from verification.studies.regression.baseline import Entry
from verification.studies.regression.baseline_entry import Observation

STENCIL = 4  # a cubic between simulated points, 1e-7 of a ringing amplitude at 125 points a period
UNITS = {name: figure.unit for name, figure in (FIGURES | CHANNEL_FIGURES).items()}


@dataclass(frozen=True, slots=True)
class Difference:
    """One quantity beside its baseline.

    Attributes
    ----------
    group : str
        ``"checks"``, ``"states"``, ``"levels"``, ``"times"``, ``"poles"`` or ``"waveforms"``.
    name : str
        Which of them.
    value, baseline : float, str or None
        Now and then, in `unit`; None where there is none. Of a waveform, the two norms.
    tolerance : float or None
        How far they may be apart, in `unit`; None where they must be equal.
    off : float
        How many tolerances they are apart; infinite where they cannot be compared.
    unit : str
        SI unit, ``"step"`` for step amplitudes, or empty.
    note : str
        Where a waveform is off the most.
    """

    group: str
    name: str
    value: float | str | None
    baseline: float | str | None
    tolerance: float | None
    off: float
    unit: str = ""
    note: str = ""

    @property
    def changed(self) -> bool:
        """Whether it is more than a tolerance off."""
        return not self.off <= 1.0


def compare(now: Observation, then: Entry, allowed: Regression) -> tuple[Difference, ...]:
    """Compare a scene's results with its entry in the baseline.

    Every quantity that either has is compared, but for checks that only one of them ran.
    """
    entry = now.entry
    both = [name for name in then.checks if name in entry.checks]
    found = [_equal("checks", name, entry.checks[name], then.checks[name]) for name in both]
    for name in _names(entry.states, then.states):
        found.append(_equal("states", name, entry.states.get(name), then.states.get(name)))
    found += _numbers("poles", entry.poles, then.poles, allowed.poles, then.speed)
    if entry.stable == then.stable:  # else the rest has nothing to be compared with
        found += _numbers("levels", entry.levels, then.levels, allowed.levels, then.amplitude)
        found += _times(entry, then, allowed.times)
        found += _waveforms(now, then, allowed.waveforms)
    return tuple(found)


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
    """Compare numbers whose absolute tolerance counts in `scale`, ratios apart."""
    for name in _names(now, then):
        unit = UNITS.get(name.rpartition(".")[2]) or "ratio"
        size = allowed.absolute * (1.0 if unit in ("step", "ratio") else scale)
        yield _number(group, name, now.get(name), then.get(name), allowed.relative, size, unit)


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
    """Compare times; of a fragile one, the nearest of its values counts."""
    for name in _names(entry.times, then.times):
        pairs = product(entry.times.get(name, [None]), then.times.get(name, [None]))
        yield min(
            (
                _number("times", name, a, b, allowed.relative, allowed.absolute, "s")
                for a, b in pairs
            ),
            key=lambda difference: difference.off,
        )


def _waveforms(now: Observation, then: Entry, allowed: WaveformTolerance) -> Iterator[Difference]:
    """Compare the outputs at the baseline's instants, the simulated points interpolated there."""
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
