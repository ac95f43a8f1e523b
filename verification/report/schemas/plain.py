"""The documents of commands without a simulation."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from verification.report.schemas.shared import (
    Certificate,
    Document,
    Free,
    Load,
    Number,
    Omission,
    Part,
    Word,
)
from verification.report.schemas.studies import Candidate
from verification.report.schemas.verdict import VerdictBody


class NetlistDocument(Document):
    """``taction netlist``."""

    files: list[str]
    deck: Word
    omissions: list[Omission]
    pruning: Free | None
    warnings: list[str]
    lam: Number = Field(alias="lambda")


class Preferred(Part):
    """The nearest preferred value."""

    series: str
    value: Number
    deviation: Number


class Line(Part):
    """Equal parts."""

    kind: str
    value: Number
    references: list[str]
    tolerance: Number
    preferred: Preferred | None
    unit: str
    count: int
    standard: bool


class Package(Part):
    """A package of op-amps."""

    reference: str
    opamps: list[str]
    spare: int


class Packages(Part):
    """All packages of op-amps."""

    preset: str
    packages: list[Package]
    spare: int


class BomDocument(Document):
    """``taction bom``; `power` in W and A."""

    scene: str
    parts: list[Line]
    opamps: Packages
    power: dict[str, Number]
    not_listed: list[str]


class KicadDocument(Document):
    """``taction kicad``; `channel` and `row` count from 1."""

    scene: str
    files: list[str]
    channel: int
    row: int
    not_drawn: list[str]


class SolveDocument(Document):
    """``taction solve``."""

    outcome: str
    u: list[Number]
    v: list[Number] | None
    lam: Number = Field(alias="lambda")
    objective: Number
    certificate: Certificate
    error_bound: Number
    condition: Number
    iterations: int
    trusted: bool
    reason: str
    seconds: Number


class TuneDocument(Document):
    """``taction tune``."""

    outcome: str
    before: Candidate
    after: Candidate
    resistance: Number
    lam: Number = Field(alias="lambda")
    overshoot_limit: Number
    margin: Number
    tried: int
    ranges: dict[str, list[Number]]
    at_edges: dict[str, Number]
    frontier: list[Candidate]
    verification: VerdictBody


class ScaleDocument(Document):
    """``taction scale``."""

    outcome: str
    unit_conductance: Number
    unit_voltage: Number
    gain: Number
    resistance: Number
    capacitance: Number
    lam: Number = Field(alias="lambda")
    matrix_resistors: list[Number]
    headroom: list[Load]
    notes: list[str]
    verification: VerdictBody


class Finding(Part):
    """A part of the installation."""

    what: str
    ok: bool
    found: str
    means: str


class DoctorDocument(Document):
    """``taction doctor``."""

    findings: list[Finding]
    ok: bool


class ModelsDocument(Document):
    """``taction models``: the figures of each preset, by its name."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, Number | str]] = Field(init=False)


class Figure(Part):
    """A figure of a data sheet."""

    value: Number
    unit: str
    note: str = Field(description="what the sheet says beside it, or how it was derived")


class ShowDocument(Document):
    """``taction models show``: one op-amp."""

    name: str
    source: str
    external_part: str
    figures: dict[str, Figure]
    supply: Number = Field(description="of the test benches, both voltages")
    measured: dict[str, dict[str, Number | str]] = Field(
        description="by figure: its unit, its stated value, and that of each engine"
    )


class Parameter(Part):
    """An argument or an option of a command."""

    name: str
    type: str
    required: bool
    several: bool
    min: Number = None
    max: Number = None
    choices: list[str] = Field([])
    flags: list[str] = Field([], description="of an option")
    is_flag: bool = False
    default: bool | int | float | str | None = None
    metavar: Word = None
    envvar: Word = None
    help: str = ""


class Command(Part):
    """A command."""

    name: str
    usage: str
    help: str
    arguments: list[Parameter]
    options: list[Parameter]
    schemas: list[str]


class HelpDocument(Document):
    """``taction --json --help``."""

    program: str
    usage: str
    commands: list[Command]
    exit_statuses: dict[str, str]
    environment: dict[str, str]
    schemas: dict[str, Free]
    scene_schema: Free


class NewDocument(Document):
    """``taction new``."""

    model_config = ConfigDict(extra="allow")
