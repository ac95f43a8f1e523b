"""The numbers and checks of a verdict beside the true ones."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from taction.system.reading_definitions import READINGS
from taction.verification.evidence.stress.true_values import TrueValues
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.transient_plan import SHARE
from taction.verification.verdict.verify import Verdict

MARGIN = 1e-5  # of a margin: its stated error
LEAST_TOLERANCE = 1e-3  # of the step: a scene that asks for less allows it for its readings
LAST_LEVEL = 0.1  # of the step: distance of a rise time's last level from the target
NETWORK = ("steady_state", *READINGS)
RESTING = ("steady_state", "settling_time")  # also judged by where drawn boards rest


@dataclass(frozen=True, slots=True)
class TruthComparison:
    """One stated number with its true value."""

    DOCUMENT = ("name", "value", "uncertainty", "truth", "error", "unit", "outside", "wrong")

    name: str  # of the quantity, with its channel
    value: float  # as the verdict states it, in `unit`
    uncertainty: float
    truth: float  # NaN where there is none, although one is stated
    unit: str  # "s", "1/s", "step", "V" or "ratio"
    doubt: float  # error of `truth`
    accuracy: float  # the error that the scene allows, in `unit`

    @property
    def error(self) -> float:
        """The true error of the stated value."""
        return abs(self.value - self.truth)

    @property
    def ratio(self) -> float:
        """True error over stated error."""
        excess = self.error - self.doubt
        if excess <= 0.0:
            return min(self.error / self.uncertainty, 1.0) if self.uncertainty > 0.0 else 1.0
        return excess / self.uncertainty if self.uncertainty > 0.0 else math.inf

    @property
    def outside(self) -> bool:
        """Whether the true value is outside the stated uncertainty."""
        return not self.ratio <= 1.0

    @property
    def wrong(self) -> bool:
        """Whether the true value is outside by more than the scene allows, or does not exist."""
        return not self.error <= self.doubt + self.uncertainty + self.accuracy


def compare(verdict: Verdict, truth: TrueValues) -> tuple[TruthComparison, ...]:
    """Compare every number that a verdict states with its true value.

    An undecided verdict states no readings. The outputs of a board that never arrives at its
    equilibrium have no readings that a finite record could show: only its poles are compared.
    """
    numbers = _Numbers(verdict, truth)
    poles = tuple(numbers.poles())
    if truth.rightmost[0] >= 0.0 or not truth.arrives or not truth.amplitude:
        return poles
    static = tuple(numbers.static())
    if not truth.readable or verdict.outcome is Outcome.INCONCLUSIVE:
        return (*static, *poles)
    return (*static, *numbers.checks(), *numbers.channels(), *poles)


def worst(comparisons: tuple[TruthComparison, ...]) -> TruthComparison | None:
    """Return the comparison with the largest ratio."""

    def rank(comparison: TruthComparison) -> float:
        return math.inf if math.isnan(comparison.ratio) else comparison.ratio

    return max(comparisons, key=rank, default=None)


def wrong_checks(verdict: Verdict, truth: TrueValues) -> Iterator[str]:
    """Yield the decided checks whose outcome contradicts the true value, with both."""
    for check in verdict.checks:
        right = _right_outcome(check, verdict, truth)
        if right is Outcome.PASS and check.name in RESTING and _varies(verdict):
            continue
        if right is not None and check.outcome not in (right, Outcome.INCONCLUSIVE):
            yield f"{check.name} is {check.outcome.value}, the truth is {right.value}"


def _right_outcome(check: Check, verdict: Verdict, truth: TrueValues) -> Outcome | None:
    """Return the outcome of a check by the true values; None if they do not decide it."""
    limits: Any = getattr(verdict.scene.checks, check.name, None)
    if check.name == "stability":
        stable = truth.rightmost[0] < 0.0
        if limits.margin > 1.0 and stable:
            return None if truth.margin is None else _passed(truth.margin >= limits.margin)
        return _passed(stable)
    if check.name not in NETWORK or not truth.amplitude:
        return None
    if truth.rightmost[0] >= 0.0 or not truth.arrives:
        return None if check.name == "rise_time" else Outcome.FAIL
    if check.name == "steady_state":
        return _passed(truth.steady_state <= limits.tolerance)
    if not truth.readable:
        return None
    value = _of_the_network(check.name, verdict, truth)
    if math.isnan(value):
        return Outcome.FAIL
    lowest = getattr(limits, "min", None) or 0.0
    highest = math.inf if limits.max is None else limits.max
    return _passed(lowest <= value <= highest)


def _varies(verdict: Verdict) -> bool:
    """Whether the steady state is judged by how parts differ: a deck has one of each only."""
    return verdict.evidence.spread is not None


def _passed(right: bool) -> Outcome:
    return Outcome.PASS if right else Outcome.FAIL


def _of_the_network(name: str, verdict: Verdict, truth: TrueValues) -> float:
    """Return the true value of a check; NaN if there is none."""
    if name == "steady_state":
        return truth.steady_state
    if name == "rise_time":
        limits = verdict.scene.checks.rise_time
        if limits is not None and limits.channel is not None:
            return truth.channels[limits.channel - 1].get(name, math.nan)
    if name == "settling_time" and not truth.settles:
        return math.nan
    largest = truth.largest(name)
    return math.nan if largest is None else largest


@dataclass(frozen=True, slots=True)
class _Numbers:
    """The numbers that a verdict states, with their true values."""

    verdict: Verdict
    truth: TrueValues

    def static(self) -> Iterator[TruthComparison]:
        """Yield the outputs at the equilibrium."""
        steady, amplitude = self.verdict.steady, self.truth.amplitude
        for n, (value, true) in enumerate(zip(steady.values, self.truth.channels, strict=True)):
            name, final = f"final value of u_{n + 1}", true["final"]
            yield self._number(name, float(value), steady.error, final, "V", amplitude)

    def checks(self) -> Iterator[TruthComparison]:
        """Yield the numbers of the decided checks of the network."""
        for check in self.verdict.checks:
            value, uncertainty = check.value, check.uncertainty
            unknown = check.outcome is Outcome.INCONCLUSIVE
            unknown |= check.name == "steady_state" and _varies(self.verdict)
            if check.name in NETWORK and not unknown and None not in (value, uncertainty):
                true = _of_the_network(check.name, self.verdict, self.truth)
                yield self._number(check.name, value or 0.0, uncertainty or 0.0, true, check.unit)

    def channels(self) -> Iterator[TruthComparison]:
        """Yield the readings of the channels."""
        channels = self.verdict.measurements.channels
        for channel, true in zip(channels, self.truth.channels, strict=True):
            for name, reading in channel.readings.items():
                if reading is not None:
                    label = f"{name} of u_{channel.index + 1}"
                    value, error, unit = reading.value, reading.uncertainty, READINGS[name].unit
                    yield self._number(label, value, error, true.get(name, math.nan), unit)

    def poles(self) -> Iterator[TruthComparison]:
        """Yield the rightmost pole and the margin."""
        found, truth = self.verdict.poles, self.truth
        lead, resolution = truth.rightmost[0], found.resolution
        yield self._number("rightmost pole", found.rightmost.real, resolution, lead, "1/s")
        margin = self.verdict.margin
        if margin is not None and truth.margin is not None:
            doubt = MARGIN * margin.factor
            yield self._number("margin", margin.factor, doubt, truth.margin, "ratio")

    def _number(
        self, name: str, value: float, error: float, truth: float, unit: str, scale: float = 1.0
    ) -> TruthComparison:
        """Return a comparison; errors of times, poles and margins are relative, else of `scale`."""
        size, share = (scale if unit in ("step", "V") else abs(truth)), self._allowed(name)
        return TruthComparison(
            name, value, error, truth, unit, self.truth.error * size, share * size
        )

    def _allowed(self, name: str) -> float:
        """Return the error that the scene allows for a number, as a fraction.

        An error of the transient moves the instant at which it crosses a level by about the same
        fraction of the time as the error is of the distance to the target.
        """
        scene, error = self.verdict.scene, self.verdict.scene.analysis.error
        tolerance = scene.checks.steady_state.tolerance
        if name == "steady_state":
            return tolerance
        wanted = SHARE * max(tolerance, LEAST_TOLERANCE)
        if isinstance(error, float):
            wanted = max(wanted, error)
        if name.startswith("settling_time"):
            return wanted / scene.checks.settling_time.band
        return wanted / LAST_LEVEL if name.startswith("rise_time") else wanted
