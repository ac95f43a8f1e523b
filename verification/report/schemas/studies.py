"""The documents of commands that run many boards."""

from __future__ import annotations

from pydantic import Field

from verification.report.schemas.shared import (
    Check,
    Document,
    Free,
    Number,
    Part,
    Sample,
    Word,
)


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
    remedy: Free | None = Field(description="what to buy better")


class Scanned(Part):
    """The values whose poles were computed."""

    low: Number = Field(alias="from")
    high: Number = Field(alias="to")
    points: int
    scale: str
    default: bool


class OnsetDocument(Document):
    """``taction onset``."""

    scene: str
    file: str
    over: str
    unit: str
    own_value: Number
    scanned: Scanned
    complete: bool
    crossings: list[Free]
    unstable_counts: list[Free]
    stable_ranges: list[list[Number]]
    unresolved: list[list[Number]]
    failures: list[Free]


class Axis(Part):
    """An axis of a grid; axes of one `group` change together."""

    name: str
    key: str
    unit: str
    scale: str
    group: int
    values: list[bool | int | float | str]


class SweepDocument(Document):
    """``taction sweep``."""

    scene: str
    file: str
    database: str
    axes: list[Axis]
    engines: list[str]
    total: int
    done: int
    ran: int
    outcomes: dict[str, int]
    agreement: Free | None
    seconds: Number
    estimated_seconds: Number
    points: list[Free]


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
    value: float | str | None
    baseline: float | str | None
    tolerance: Number
    off: Number
    unit: str
    note: str
    changed: bool


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


class StressDocument(Document):
    """``taction stress``."""

    runs: list[Free]
    count: dict[str, int]
    numbers: int
    outside: int
    versions: dict[str, str]


class AccuracyDocument(Document):
    """``taction accuracy``."""

    scene: str
    file: str
    stop: Number
    whole_stop: Number
    stretch: str
    period: Number
    pole: list[Number] | None
    norms: list[str]
    problems: dict[str, Free]
    methods: list[Free]
    cheapest: list[Free]
    omissions: list[str]
    machine: Free
    seconds: Number


class ReproduceDocument(Document):
    """``taction reproduce``."""

    outcome: str
    quick: bool
    seconds: Number
    machine: Free
    claims: list[Free]
    left_out: list[str]
    chapters: list[Free]


class Candidate(Part):
    """A design and its readings."""

    values: dict[str, Number]
    settling_time: Number
    overshoot: Number
    left: list[str]
    refused: str
