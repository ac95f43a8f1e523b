"""The documents of commands that go over the values of a key: ``sweep`` and ``onset``."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from taction.verification.report.schemas.shared import (
    Check,
    Document,
    Number,
    Outcome,
    Part,
    PlainChannel,
    Value,
    Word,
)

PointOutcome = Literal["pass", "fail", "inconclusive", "error"]


class Axis(Part):
    """An axis of a grid; axes of one `group` change together."""

    name: str
    key: str
    unit: str
    scale: str
    group: int
    values: list[Value]


class Point(Part):
    """A point of a sweep on one engine; `values` by the names of the axes."""

    values: dict[str, Value]
    outcome: PointOutcome = Field(description="'error': no verdict, see `failure`")
    failure: Word = Field(description="class of the error of a point without a verdict")
    reason: str
    engine: str
    simulator: Word
    state: Word
    stable: bool | None
    settling_time: Number
    rise_time: Number
    overshoot: Number
    undershoot: Number
    steady_state_error: Number
    end_error: Number
    growth_rate: Number
    frequency: Number
    damping_ratio: Number
    margin: Number
    noise: Number
    step_amplitude: Number
    lam: Number = Field(alias="lambda")
    resistance: Number
    simulation_error: Number
    seconds: Number
    wanted_error: Number
    attained_error: Number
    uncertainties: dict[str, Number] = Field(description="bounds on the errors of figures")
    alternatives: dict[str, Number] = Field(
        description="of a fragile time: its value after a small change of a level"
    )
    checks: list[Check]
    channels: list[PlainChannel] = Field(description="empty: a sweep keeps no channels")
    rightmost_pole: list[Number] | None
    chosen: Word = Field(description="why a hybrid sweep confirms the point by ngspice")
    agreement: Outcome | None = Field(description="of both engines")
    difference: Number
    disagreement: Word


class Agreement(Part):
    """How far two engines agree."""

    points: int
    agree: int
    disagree: int
    undecided: int
    chosen: dict[str, int]
    largest_difference: Number
    at: dict[str, Value] | None
    listed: list[Point]


class PointCounts(Part):
    """How many points have which outcome."""

    passing: int = Field(0, alias="pass")
    fail: int = 0
    inconclusive: int = 0
    error: int = 0


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
    outcomes: PointCounts
    agreement: Agreement | None
    seconds: Number
    estimated_seconds: Number
    points: list[Point]


class Scanned(Part):
    """The values whose poles were computed."""

    low: Number = Field(alias="from")
    high: Number = Field(alias="to")
    points: int
    scale: str
    default: bool


class PredictedMode(Part):
    """The crossing mode, from the poles."""

    growth_rate: Number
    frequency: Number


class MeasuredMode(PredictedMode):
    """The crossing mode, fitted to the transient."""

    growth_rate_uncertainty: Number


class Side(Part):
    """A transient beside a crossing."""

    value: Number
    predicted: PredictedMode
    measured: MeasuredMode
    agrees: bool | None
    reason: str


class UnstablePoles(Part):
    """Poles right of the imaginary axis on both sides of a crossing."""

    below: int
    above: int


class Crossing(Part):
    """A value at which a pole is on the imaginary axis."""

    value: Number
    frequency: Number
    direction: str
    changes_stability: bool
    unstable_poles: UnstablePoles | None
    confirmed: bool | None
    reason: str
    below: Side | None
    above: Side | None


class UnstableCount(Part):
    """Unstable poles at a value between crossings, by two methods."""

    value: Number
    poles: int
    winding: int | None
    reason: str


class WithoutPoles(Part):
    """A value whose poles could not be computed."""

    value: Number
    reason: str


class OnsetDocument(Document):
    """``taction onset``."""

    scene: str
    file: str
    over: str
    unit: str
    own_value: Number
    scanned: Scanned
    complete: bool
    crossings: list[Crossing]
    unstable_counts: list[UnstableCount]
    stable_ranges: list[list[Number]]
    unresolved: list[list[Number]]
    failures: list[WithoutPoles]
