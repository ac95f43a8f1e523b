"""The documents of ``taction verify`` and of commands that hold a verdict."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field

from taction.verification.report.schemas.remedies import StableRange, WhatToChange
from taction.verification.report.schemas.shared import (
    Certificate,
    Check,
    Document,
    Failure,
    Head,
    Load,
    Number,
    Omission,
    Outcome,
    Part,
    PlainChannel,
    Sample,
    Value,
    Word,
)


class Readings(Part):
    """Bounds on the errors of readings."""

    rise_time: Number
    settling_time: Number
    overshoot: Number
    undershoot: Number


class AllReadings(Readings):
    """The same, with the outputs at the end."""

    steady_state: Number


class SteadyState(Part):
    """Distance from the reference, fractions of the step amplitude."""

    equilibrium: Number
    record_end: Number


class Margin(Part):
    """By what factor a value may change until the board oscillates."""

    factor: Number
    uncertainty: Number
    text: str
    doubt: str


class Margins(Part):
    """Margins of C and of the gain; of an unstable board the nearest stable ranges by key."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, StableRange] = Field(init=False)
    capacitance: Margin
    gain: Margin


class Stability(Part):
    """The rightmost pole: real and imaginary part, 1/s, and what follows from it."""

    stable: bool
    rightmost_pole: list[Number]
    rightmost_pole_uncertainty: Number
    damping_ratio: Number
    frequency: Number
    states: int | None
    margin: Number
    margins: Margins | None = Field(None, description="with --margins")


class Energy(Part):
    """The energy of the network."""

    identity_residual: Number
    rise: Number
    rise_time: Number


class ConstraintPlane(Part):
    """The slowest stage of the constraint plane."""

    row: int
    amplifier_rise_time: Number
    stage_rise_time: Number
    stage_overshoot: Number


class BudgetPart(Part):
    """One part of the error budget, V."""

    value: Number
    unit: str
    how: str
    bound: Number
    channels: list[Number] = Field([])
    predicted: list[Number] = Field([])
    sum: list[Number] = Field([])
    solves: int = 0


class Noise(Part):
    """Noise of the outputs."""

    rms: list[Number]
    uncertainties: list[Number]
    unit: str
    ngspice: Number
    reason: str


class Accuracy(Part):
    """The error of the simulation that was wanted, and that was reached."""

    wanted: Number
    achieved: Number
    seconds: Number
    points: int
    points_per_period: Number
    engine: str
    method: str
    how: str
    tries: int


class Simulation(Part):
    """The record."""

    stop: Number
    max_step: Number
    points: int
    seconds: Number


class KeyValue(Part):
    """A key of the scene in base units; a file has the SHA-256 of its content."""

    value: Value | None
    unit: Word
    sha256: Word = None


class VerdictBody(Part):
    """A verdict."""

    scene: str
    file: str
    outcome: Outcome
    checks: list[Check]
    channels: list[PlainChannel]
    steady_state: SteadyState
    step_amplitude: Number
    step_amplitude_uncertainty: Number
    settling_time: Number
    settling_time_ideal: Number
    stability: Stability
    energy: Energy
    constraint_plane: ConstraintPlane | None
    error_budget: dict[str, BudgetPart]
    opamp_level: str
    headroom: list[Load]
    noise: Noise | None
    simulation_error: AllReadings
    accuracy: Accuracy
    lam: Number = Field(alias="lambda")
    lambda_rule: Word
    resistance: Number
    certificate: Certificate
    engine: str
    simulator: str
    solver: Word
    method: Word
    simulation: Simulation
    keys: dict[str, KeyValue]
    omissions: list[Omission]
    warnings: list[str]
    timing: dict[str, Number]
    what_to_change: WhatToChange | None = Field(
        None, description="of a failed verdict: changes that mend it"
    )


class VerifyDocument(VerdictBody):
    """``taction verify SCENE``."""

    taction: Head


class WithoutVerdict(Part):
    """A file without a verdict."""

    file: str
    outcome: Literal["bad input", "inconclusive", "not run"]
    error: Failure | None = None


class VerifyFilesDocument(Document):
    """``taction verify`` with several scenes or a folder."""

    outcome: str = Field(description="the worst")
    exit_status: int
    interrupted: bool
    counts: dict[str, int]
    verdicts: list[VerdictBody | WithoutVerdict]


class SampleDocument(VerifyDocument):
    """``taction montecarlo --sample``."""

    seed: int
    sample: Sample
    deviations: dict[str, Number]


class SimulateDocument(Document):
    """``taction simulate``."""

    scene: str
    simulator: str
    solver: Word
    method: Word
    points: int
    seconds: Number
    stop: Number
    step_amplitude: Number
    settling_time: Number
    channels: list[PlainChannel]
    output: Word
