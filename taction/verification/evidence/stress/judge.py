"""The numbers and checks of a verdict beside the true ones, as stored beside the catalogue."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from taction.netlist_gen.scene.scene import Scene
from taction.system.reading_definitions import READINGS
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.transient_plan import SHARE
from taction.verification.verdict.verify import Verdict


@dataclass(frozen=True, slots=True)
class TrueValues:
    """The true readings of a case's board."""

    amplitude: float  # of the step, V
    rightmost: tuple[float, float]  # pole, 1/s
    steady_state: float  # largest distance of the equilibrium from the reference, of the step
    channels: tuple[Mapping[str, float], ...]  # the `READINGS` and `final` that exist
    error: float  # of the numbers: relative for times, of the step for the others
    by: str  # how the numbers were computed
    arrives: bool = True  # False: stable, but the transient leaves every bound
    readable: bool = True  # False: it rings for so many periods that readings were not computed
    margin: float | None = None  # factor by which C shrinks until the board oscillates, if known

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> TrueValues:
        """Return the values of a JSON record."""
        fixed = {"rightmost": tuple(record["rightmost"]), "channels": tuple(record["channels"])}
        return cls(**{**record, **fixed})

    def record(self) -> dict[str, Any]:
        """Return the values as a JSON record."""
        return asdict(self)

    @property
    def settles(self) -> bool:
        """Whether every channel has a settling time."""
        return all("settling_time" in channel for channel in self.channels)

    def largest(self, reading: str) -> float | None:
        """Return the largest of a reading over the channels; None if no channel has it."""
        values = [channel[reading] for channel in self.channels if reading in channel]
        return max(values, default=None)


MARGIN = 1e-5  # of a margin: its stated error
LEAST_TOLERANCE = 1e-3  # of the step: a scene that asks for less allows it for its readings
LAST_LEVEL = 0.1  # of the step: distance of a rise time's last level from the target
NETWORK = ("steady_state", *READINGS)
_Stated = tuple[str, float, float, float, str]  # name, value, stated error, truth, unit
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
    """Compare every number that a verdict states with its true value."""
    found = []
    for name, value, uncertainty, true, unit in _stated(verdict, truth):
        # Errors of times, poles and margins are relative, those of voltages are of the step.
        size = {"step": 1.0, "V": truth.amplitude}.get(unit, abs(true))
        doubt, accuracy = truth.error * size, _allowed(verdict.scene, name) * size
        found.append(TruthComparison(name, value, uncertainty, true, unit, doubt, accuracy))
    return tuple(found)


def _stated(verdict: Verdict, truth: TrueValues) -> Iterator[_Stated]:
    """Yield name, value, stated error, true value and unit of every number of a verdict."""
    if truth.rightmost[0] < 0.0 and truth.arrives and truth.amplitude:
        steady = verdict.steady
        for n, (value, true) in enumerate(zip(steady.values, truth.channels, strict=True), 1):
            yield f"final value of u_{n}", float(value), steady.error, true["final"], "V"
        if truth.readable and verdict.outcome is not Outcome.INCONCLUSIVE:
            yield from _readings(verdict, truth)
    poles, margin = verdict.poles, verdict.margin
    lead = truth.rightmost[0]
    yield "rightmost pole", poles.rightmost.real, poles.resolution, lead, "1/s"
    if margin is not None and truth.margin is not None:
        yield "margin", margin.factor, MARGIN * margin.factor, truth.margin, "ratio"


def _readings(verdict: Verdict, truth: TrueValues) -> Iterator[_Stated]:
    """Yield the numbers of the decided checks of the network, and the readings of the channels."""
    for check in verdict.checks:
        value, uncertainty = check.value, check.uncertainty
        undecided = check.outcome is Outcome.INCONCLUSIVE
        undecided |= check.name == "steady_state" and _varies(verdict)
        if value is None or uncertainty is None or undecided or check.name not in NETWORK:
            continue
        true = _of_the_network(check.name, verdict, truth)
        yield check.name, value, uncertainty, true, check.unit
    for channel, known in zip(verdict.measurements.channels, truth.channels, strict=True):
        for name, reading in channel.readings.items():
            if reading is not None:
                label, true = f"{name} of u_{channel.index + 1}", known.get(name, math.nan)
                yield label, reading.value, reading.uncertainty, true, READINGS[name].unit


def _allowed(scene: Scene, name: str) -> float:
    """Return the error that the scene allows for a number, as a fraction.

    An error of the transient moves the instant of a level by its share of the distance to the
    target.
    """
    error, tolerance = scene.analysis.error, scene.checks.steady_state.tolerance
    if name == "steady_state":
        return tolerance
    wanted = SHARE * max(tolerance, LEAST_TOLERANCE)
    if isinstance(error, float):
        wanted = max(wanted, error)
    if name.startswith("settling_time"):
        return wanted / scene.checks.settling_time.band
    return wanted / LAST_LEVEL if name.startswith("rise_time") else wanted


def worst(comparisons: tuple[TruthComparison, ...]) -> TruthComparison | None:
    """Return the comparison with the largest ratio; one without a true value comes first."""
    return max(comparisons, key=lambda each: (math.isnan(each.ratio), each.ratio), default=None)


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
    return verdict.spread is not None


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
