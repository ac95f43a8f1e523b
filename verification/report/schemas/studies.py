"""The documents of commands that run many boards."""

from __future__ import annotations

from pydantic import Field

from taction.verification.report.schemas.remedies import Remedy
from taction.verification.report.schemas.shared import Check, Document, Number, Part, Sample, Word


class Corner(Part):
    """A corner of the tolerances."""

    name: str
    quantity: str
    result: Sample
    largest: list[str]
    deviations: dict[str, Number]


class Direction(Part):
    """The worst case of one channel at rest."""

    channel: int
    sign: int
    predicted: Number
    solved: Number
    largest: list[str]
    deviations: dict[str, Number]


class CornersDocument(Document):
    """``taction corners``."""

    scene: str
    corners: list[Corner]
    directions: list[Direction]


class Spread(Part):
    """Quantiles of one quantity."""

    name: str
    unit: str
    at_least: Number
    at_most: Number
    low: Number
    median: Number
    high: Number
    missing: int


class Sensitivity(Part):
    """Correlation of a quantity with a component."""

    parameter: str
    kind: str
    quantity: str
    correlation: Number
    standard_error: Number
    channel: int | None


class MontecarloDocument(Document):
    """``taction montecarlo``."""

    scene: str
    engine: str
    seed: int
    complete: bool
    samples: int
    passed: int
    without_verdict: int
    fraction: Number
    low: Number
    high: Number
    failures: dict[str, int]
    reasons: dict[str, int]
    quantities: list[Spread]
    sensitivities: list[Sensitivity]
    remedy: Remedy | None = Field(description="what to buy better")


class Baseline(Part):
    """Where an entry of a baseline comes from."""

    outcome: str
    revision: str
    taction: str
    simulator: str
    fingerprint: str


class Difference(Part):
    """A quantity beside its baseline."""

    group: str
    name: str
    channel: int | None
    first: float | str | None = Field(description="of the baseline")
    second: float | str | None
    unit: str
    difference: Number
    allowed: Number
    off: Number = Field(description="difference over what is allowed")
    note: str
    beyond: bool | None


class RegressionScene(Part):
    """A scene beside its baseline."""

    file: str
    status: str
    outcome: Word
    reason: str
    notes: list[str]
    simulator: Word
    baseline: Baseline | None
    worst: Number
    checks: list[Check]
    differences: list[Difference]
    seconds: Number


class RegressDocument(Document):
    """``taction regress``."""

    exit_status: int
    folder: str
    baseline: str
    revision: str
    updated: bool
    interrupted: bool
    counts: dict[str, int]
    scenes: list[RegressionScene]


class Candidate(Part):
    """A design and its readings."""

    values: dict[str, Number]
    settling_time: Number
    overshoot: Number
    left: list[str]
    refused: str
