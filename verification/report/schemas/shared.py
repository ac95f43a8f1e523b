"""Parts that documents of several commands share."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = float | None  # null: unknown, or infinite
Word = str | None
Value = bool | int | float | str
"""Of a key of the scene, in its SI base unit."""
Outcome = Literal["pass", "fail", "inconclusive"]


class Part(BaseModel):
    """A part of a document; every field is listed, and no other may occur."""

    model_config = ConfigDict(extra="forbid")


class Head(Part):
    """What made a document: `units` has the unit of every field of the document that has one."""

    version: str
    document: str = Field(alias="schema", description="name and version of the schema")
    simulator: Word = Field(description="ngspice of this machine; null where there is none")
    solver: Word = Field(description="its matrix solver")
    units: dict[str, str]


class Document(Part):
    """The part that all documents have."""

    taction: Head


class Complaint(Part):
    """One mistake in the input."""

    key: str
    value: str
    accepted: str


class Failure(Part):
    """Why there is no result."""

    kind: str
    message: str
    file: str = Field(default="", description="of bad input")
    complaints: list[Complaint] = Field([])
    log: str = ""
    folder: Word = None


class ErrorDocument(Document):
    """Any command that ended without its document."""

    outcome: Literal["bad input", "inconclusive"]
    error: Failure


class Check(Part):
    """One check of a verdict."""

    name: str
    outcome: Outcome
    value: Number
    uncertainty: Number
    expected: Number
    tolerance: Number
    unit: str
    reason: str


class PlainChannel(Part):
    """Readings of one output; `index` counts from 1."""

    index: int
    reference: Number
    final: Number
    rise_time: Number
    settling_time: Number
    overshoot: Number
    undershoot: Number
    frequency: Number
    growth_rate: Number
    state: str
    fragile: bool
    uncertainties: dict[str, Number] = Field(description="bounds on the errors of the readings")
    alternatives: dict[str, Number] = Field(
        description="of a fragile time: its value after a small change of a level"
    )
    equilibrium: Number
    reason: str


class Omission(Part):
    """A part that the board leaves out."""

    what: str
    why: str


class Certificate(Part):
    """The certificate of a numerical solution."""

    kind: str
    value: Number
    bound: Number


class Sample(Part):
    """A board within its tolerances; `errors` are those of the outputs at rest."""

    number: int
    outcome: Literal["pass", "fail", "inconclusive", "error"]
    failure: Word
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
    wanted_error: Number
    attained_error: Number
    simulation_error: Number
    seconds: Number
    uncertainties: dict[str, Number]
    alternatives: dict[str, Number]
    checks: list[Check]
    channels: list[PlainChannel]
    errors: list[Number]


class Load(Part):
    """What an op-amp has to do, beside its limit."""

    part: str
    quantity: str
    peak: Number
    limit: Number
    rest: Number
    error: Number
    time: Number
    share: Number
    unit: str


class Machine(Part):
    """The machine and the versions of a study."""

    date: str
    processor: str
    cores: int | None
    load: Number
    threads: str
    system: str
    python: str
    ngspice: Word
    taction: str
    numpy: str
    scipy: str


Free = dict[str, Any]
"""A JSON Schema: the only part of a document whose fields are not listed."""
