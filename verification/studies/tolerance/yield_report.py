"""Yield of a board whose components differ: samples, confidence interval, ranked sensitivities.

Every sample is a verification of its own, with a random stream of its own: sample 17 of seed 1 is
the same board on any machine, whatever ran before it. A sample without verdict is no pass, and it
counts in the denominator.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from netlist_gen.board.variation import draw
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.studies.running.executors import Workers
from verification.studies.tolerance.sample_store import SampleStore
from verification.studies.tolerance.varied_board import (
    Quantity,
    Sample,
    VariedBoard,
    quantities,
    run,
)

CONFIDENCE = 0.95
LEAST_SAMPLES = 30  # before a yield is called narrow enough, and before sensitivities are given
SIGNIFICANT = 4.0  # standard errors of a correlation that is told: hundreds are looked at
SHARES = (0.05, 0.5, 0.95)  # quantiles in the report


@dataclass(frozen=True, slots=True)
class Spread:
    """How a quantity is spread over the samples.

    Attributes
    ----------
    name, unit : str
        ``"s"``, ``"step"`` (fraction of the step amplitude), ``"1/s"`` or ``"ratio"``.
    at_least, at_most : float or None
        What the scene's check accepts.
    low, median, high : float
        Quantiles of 5, 50 and 95 %, each the value of one sample; infinite for a time that the
        sample does not have, since it never settles or rises. Not a number without samples.
    missing : int
        Samples that do not have it.
    """

    name: str
    unit: str
    at_least: float | None
    at_most: float | None
    low: float
    median: float
    high: float
    missing: int


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """How a quantity moves with a component.

    `correlation` is between the component's deviation and the quantity over the samples (the
    settling time's logarithm; for the steady state the signed error of the channel with the largest
    root mean square, whose number, from 1, is `channel`). Its square is the share of the variance
    that the component explains.
    """

    parameter: str
    kind: str
    quantity: str
    correlation: float
    standard_error: float
    channel: int | None = None


@dataclass(frozen=True, slots=True, repr=False)
class YieldReport:
    """What the samples say; `reasons` counts why some have no verdict."""

    samples: int
    passed: int
    without_verdict: int
    fraction: float
    low: float
    high: float
    failures: dict[str, int]
    reasons: dict[str, int]
    quantities: tuple[Spread, ...]
    sensitivities: tuple[Sensitivity, ...]

    def __repr__(self) -> str:
        return (
            f"YieldReport({self.passed} of {self.samples} pass,"
            f" 95 % interval {100 * self.low:.3g} to {100 * self.high:.3g} %)"
        )


@dataclass(slots=True)
class Tally:
    """Counts samples in the order of their numbers, and says when there are enough.

    What is counted does not depend on which sample ended first, so neither does the yield.

    Attributes
    ----------
    wanted : int
        Samples at the most.
    width : float or None
        Half width of the interval that is narrow enough.
    samples : list of Sample
        Numbers 0, 1, 2 ... without a gap.
    """

    wanted: int
    width: float | None = None
    samples: list[Sample] = field(default_factory=list)
    passed: int = 0
    enough: bool = False
    _early: dict[int, Sample] = field(default_factory=dict)

    def add(self, sample: Sample) -> None:
        """Take a sample; it counts as soon as all before it are there."""
        self._early[sample.number] = sample
        while not self.enough and (following := self._early.pop(len(self.samples), None)):
            self.samples.append(following)
            self.passed += following.outcome == "pass"
            self.enough = len(self.samples) >= self.wanted or self._narrow()

    def _narrow(self) -> bool:
        if self.width is None or len(self.samples) < LEAST_SAMPLES:
            return False
        low, high = interval(self.passed, len(self.samples))
        return 0.5 * (high - low) <= self.width


def run_samples(
    study: VariedBoard,
    numbers: Iterable[int],
    seed: int,
    workers: Workers,
    tally: Tally,
    kept: SampleStore | None = None,
) -> Iterator[Sample]:
    """Draw and judge samples and yield them as they end, until `tally`, which is fed, has enough.

    Parameters
    ----------
    kept : SampleStore, optional
        Feeds the tally with the samples that it has, and takes the others as they end.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        As `verification.studies.tolerance.varied_board.run` and `SampleStore`.
    """

    def missing() -> Iterator[tuple[int, Floats]]:
        for number in numbers:
            if tally.enough:
                return
            if kept is not None and (known := kept.get(number)) is not None:
                tally.add(known)
            else:
                yield number, draw(study.scene.tolerances, len(study.varied), seed, number)

    for sample in run(study, missing(), workers, lambda: tally.enough):
        if kept is not None:
            kept.put(sample)
        tally.add(sample)
        yield sample


def report(study: VariedBoard, samples: list[Sample], seed: int) -> YieldReport:
    """Sum up samples: yield with its interval, what failed, spreads, ranked sensitivities."""
    passed = sum(sample.outcome == "pass" for sample in samples)
    low, high = interval(passed, len(samples))
    failures = Counter(name for sample in samples for name in sample.failed)
    undecided = [sample for sample in samples if sample.outcome == "inconclusive"]
    told = quantities(study.scene)
    return YieldReport(
        samples=len(samples),
        passed=passed,
        without_verdict=len(undecided),
        fraction=passed / len(samples) if samples else math.nan,
        low=low,
        high=high,
        failures=dict(failures.most_common()),
        reasons=dict(Counter(s.reason for s in undecided if s.reason).most_common()),
        quantities=tuple(_spread(study.scene, quantity, samples) for quantity in told),
        sensitivities=tuple(_sensitivities(study, told, samples, seed)),
    )


def interval(passed: int, samples: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Clopper and Pearson's exact interval of a yield; (0, 1) without samples."""
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if passed == 0 else float(betaincinv(passed, samples - passed + 1, tail))
    high = 1.0
    if passed < samples:
        high = float(betaincinv(passed + 1, samples - passed, 1.0 - tail))
    return low, high


def _spread(scene: Scene, quantity: Quantity, samples: list[Sample]) -> Spread:
    values = [getattr(sample, quantity.name) for sample in samples if not sample.reason]
    missing = sum(value is None for value in values)
    never = math.inf if quantity.unit == "s" else math.nan
    known = np.array([never if value is None else value for value in values], dtype=np.float64)
    known = known[~np.isnan(known)]
    low = median = high = math.nan
    if len(known):
        low, median, high = np.quantile(known, SHARES, method="inverted_cdf").tolist()
    least, most = _limits(scene, quantity.name)
    return Spread(quantity.name, quantity.unit, least, most, low, median, high, missing)


def _limits(scene: Scene, name: str) -> tuple[float | None, float | None]:
    """Return what the scene's check of a quantity accepts: at least, at most."""
    checks = scene.checks
    rise, overshoot = checks.rise_time, checks.overshoot
    table: dict[str, tuple[float | None, float | None]] = {
        "settling_time": (None, checks.settling_time.max),
        "rise_time": (rise.min, rise.max) if rise else (None, None),
        "overshoot": (None, overshoot.max if overshoot else None),
        "steady_state": (None, checks.steady_state.tolerance),
        "growth_rate": (None, 0.0),
        "margin": (checks.stability.margin, None),
    }
    return table[name]


def _sensitivities(
    study: VariedBoard, told: tuple[Quantity, ...], samples: list[Sample], seed: int
) -> list[Sensitivity]:
    """Return the correlations beyond `SIGNIFICANT` standard errors, the strongest first."""
    tolerances, count = study.scene.tolerances, len(study.varied)
    found = []
    for quantity in told:
        if quantity.name == "margin":  # followed only as far as the check wants it
            continue
        channel = _furthest(samples) if quantity.name == "steady_state" else None
        pairs = [(sample.number, _value(sample, quantity.name, channel)) for sample in samples]
        usable = [(n, v) for n, v in pairs if v is not None and math.isfinite(v)]
        if len(usable) < LEAST_SAMPLES:
            continue
        values = np.array([value for _, value in usable])
        if quantity.unit == "s":
            values = np.log(np.maximum(values, 1e-300))
        z = np.array([draw(tolerances, count, seed, number) for number, _ in usable])
        error = 1.0 / math.sqrt(len(usable))
        found += [
            Sensitivity(parameter.name, parameter.kind, quantity.name, float(r), error, channel)
            for parameter, r in zip(study.varied, _correlation(z, values), strict=True)
            if abs(r) > SIGNIFICANT * error
        ]
    return sorted(found, key=lambda each: -abs(each.correlation))


def _furthest(samples: list[Sample]) -> int | None:
    """Return the channel whose error has the largest mean square, from 1."""
    errors = np.array([sample.errors for sample in samples if sample.errors])
    return 1 + int(np.argmax((errors**2).mean(axis=0))) if len(errors) else None


def _value(sample: Sample, name: str, channel: int | None) -> float | None:
    if channel is not None:
        return sample.errors[channel - 1] if sample.errors else None
    value: float | None = getattr(sample, name)
    return value


def _correlation(z: Floats, values: Floats) -> Floats:
    z, values = z - z.mean(axis=0), values - values.mean()
    scale = np.sqrt((z**2).sum(axis=0) * (values**2).sum())
    return np.asarray((z * values[:, None]).sum(axis=0) / np.where(scale > 0, scale, np.inf))
