"""The documents of commands that test taction: ``accuracy``, ``reproduce`` and ``stress``."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from taction.verification.report.schemas.shared import Check, Document, Machine, Number, Part, Word


class NumberErrors(Part):
    """Errors by norm; null where unknown."""

    final: Number
    maximum: Number
    settling_time: Number
    frequency: Number
    growth_rate: Number


class MeasuredProblem(Part):
    """A problem that methods solve, with its reference."""

    references: list[str]
    reference_error: NumberErrors
    step_amplitude: Number
    settling_band: Number
    settling_time: Number
    ringing: list[Number] | None = Field(description="the ringing pole, 1/s")


class Setting(Part):
    """A method with one setting."""

    setting: Number
    status: str
    seconds: Number
    seconds_fastest: Number
    seconds_slowest: Number
    repeats: int
    steps: int | None
    factorisations: int | None
    mean_step: Number
    errors: NumberErrors
    reference: str
    note: str


class MethodRuns(Part):
    """A method with its settings and its order of convergence."""

    name: str
    engine: str
    problem: str
    setting: str
    order: Number
    order_uncertainty: Number
    order_theory: Number
    order_theory_says: str
    order_points: list[Number]
    order_reason: str
    points: list[Setting]


class CheapestSetting(Part):
    """The setting with the least run time below an error."""

    method: str
    setting: Number
    seconds: Number
    achieved: Number


class Cheapest(Part):
    """The cheapest setting below an error: of any engine, and of ngspice."""

    error: Number
    any: CheapestSetting | None
    ngspice: CheapestSetting | None


class AccuracyDocument(Document):
    """``taction accuracy``; errors are fractions."""

    scene: str
    file: str
    stop: Number
    whole_stop: Number
    stretch: str
    period: Number
    pole: list[Number] | None
    norms: list[str]
    problems: dict[str, MeasuredProblem]
    methods: list[MethodRuns]
    cheapest: list[Cheapest]
    omissions: list[str]
    machine: Machine
    seconds: Number


class Claim(Part):
    """A claim of the paper; `values` holds the numbers behind `ours`, in SI base units."""

    id: str
    claim: str
    place: str
    run: str
    printed: str
    ours: str
    verdict: str
    expected: str
    as_expected: bool
    values: dict[str, Number]


class Chapter(Part):
    """A part of the run."""

    title: str
    seconds: Number


class ReproduceDocument(Document):
    """``taction reproduce``."""

    outcome: Literal["pass", "fail", "inconclusive"]
    quick: bool
    seconds: Number
    machine: Machine
    claims: list[Claim]
    left_out: list[str]
    chapters: list[Chapter]


class StressNumber(Part):
    """A stated number beside its true value."""

    name: str
    value: Number
    uncertainty: Number
    truth: Number
    error: Number
    unit: str
    outside: bool
    wrong: bool


class StressRun(Part):
    """A case on one engine."""

    case: str
    family: str
    engine: str
    why: str = Field(description="what makes the case hard")
    known: str = Field(description="how the true values are known")
    judgement: Literal["right", "wrong outcome", "wrong number", "not run"]
    outcome: str
    right_outcomes: list[str]
    reason: str
    seconds: Number
    checks: list[Check]
    numbers: list[StressNumber]


class StressDocument(Document):
    """``taction stress``."""

    runs: list[StressRun]
    count: dict[str, int]
    numbers: int
    outside: int
    versions: dict[str, Word]
