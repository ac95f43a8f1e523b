"""The numbers of a verdict beside the true ones."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from verification.measures.readings import Reading
from verification.studies.stress.true_values import TIMES, TrueValues
from verification.verify import Verdict

MARGIN = 1e-5  # of a margin: its stated error
NETWORK = ("steady_state", "settling_time", "rise_time", "overshoot", "undershoot")


@dataclass(frozen=True, slots=True)
class Comparison:
    """One stated number.

    Attributes
    ----------
    name : str
        Name of the quantity, with its channel.
    value, uncertainty : float
        As the verdict states them, in `unit`.
    truth : float
        The true value; NaN where there is none, although one is stated.
    unit : str
        ``"s"``, ``"1/s"``, ``"step"``, ``"V"`` or ``"ratio"``.
    doubt : float
        Error of `truth`.
    """

    name: str
    value: float
    uncertainty: float
    truth: float
    unit: str
    doubt: float

    @property
    def error(self) -> float:
        """The true error of the stated value."""
        return abs(self.value - self.truth)

    @property
    def ratio(self) -> float:
        """True error over stated error, above 1 for a wrong number."""
        excess = self.error - self.doubt
        if excess <= 0.0:
            return min(self.error / self.uncertainty, 1.0) if self.uncertainty > 0.0 else 1.0
        return excess / self.uncertainty if self.uncertainty > 0.0 else math.inf

    @property
    def wrong(self) -> bool:
        """Whether the true value is outside the stated uncertainty."""
        return not self.ratio <= 1.0


def compare(verdict: Verdict, truth: TrueValues) -> tuple[Comparison, ...]:
    """Compare every number that a verdict states with its true value.

    The outputs of a board that never arrives at its equilibrium have no readings that a finite
    record could show: only its rightmost pole is compared.
    """
    poles = tuple(_poles(verdict, truth))
    if truth.rightmost[0] >= 0.0 or not truth.arrives:
        return poles
    return (*_checks(verdict, truth), *_channels(verdict, truth), *poles)


def worst(comparisons: tuple[Comparison, ...]) -> Comparison | None:
    """Return the comparison with the largest ratio."""

    def rank(comparison: Comparison) -> float:
        return math.inf if math.isnan(comparison.ratio) else comparison.ratio

    return max(comparisons, key=rank, default=None)


def _checks(verdict: Verdict, truth: TrueValues) -> Iterator[Comparison]:
    for check in verdict.checks:
        if check.name in NETWORK and check.value is not None and check.uncertainty is not None:
            true = _of_the_check(check.name, verdict, truth)
            doubt = _doubt(check.name, true, truth)
            yield Comparison(check.name, check.value, check.uncertainty, true, check.unit, doubt)


def _of_the_check(name: str, verdict: Verdict, truth: TrueValues) -> float:
    if name == "steady_state":
        return truth.steady_state
    if name == "rise_time":
        limits = verdict.scene.checks.rise_time
        count = len(truth.channels)
        number = (None if limits is None else limits.channel) or (count + 1) // 2
        return truth.channels[number - 1].get(name, math.nan)
    if name == "settling_time" and not truth.settles:
        return math.nan
    largest = truth.largest(name)
    return math.nan if largest is None else largest


def _channels(verdict: Verdict, truth: TrueValues) -> Iterator[Comparison]:
    """Compare the times of every channel, with the uncertainty that holds for the network."""
    for channel, true in zip(verdict.measurements.channels, truth.channels, strict=True):
        for name in TIMES:
            reading: Reading | None = getattr(channel, name)
            if reading is None:
                continue
            uncertainty = reading.uncertainty + getattr(verdict.error, name)
            value = true.get(name, math.nan)
            label = f"{name} of u_{channel.index + 1}"
            doubt = _doubt(name, value, truth)
            yield Comparison(label, reading.value, uncertainty, value, "s", doubt)


def _poles(verdict: Verdict, truth: TrueValues) -> Iterator[Comparison]:
    real = truth.rightmost[0]
    found, resolution = verdict.poles.rightmost.real, verdict.poles.resolution
    yield Comparison("rightmost pole", found, resolution, real, "1/s", truth.error * abs(real))
    if verdict.margin is not None and truth.margin is not None:
        factor, doubt = verdict.margin.factor, truth.error * truth.margin
        yield Comparison("margin", factor, MARGIN * factor, truth.margin, "ratio", doubt)


def _doubt(name: str, value: float, truth: TrueValues) -> float:
    return truth.error * (abs(value) if name in TIMES else 1.0)
