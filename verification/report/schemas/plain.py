"""The documents of commands without a simulation."""

from __future__ import annotations

from pydantic import Field

from taction.verification.report.schemas.shared import (
    Certificate,
    Document,
    Free,
    Load,
    Number,
    Omission,
    Outcome,
    Part,
    Word,
)
from taction.verification.report.schemas.studies import Candidate
from taction.verification.report.schemas.verdict import VerdictBody


class Pruning(Part):
    """What pruning changes and saves; null: unknown."""

    entries: int
    change: Number
    bound: Number
    resistors: int | None
    opamps: int | None


class NetlistDocument(Document):
    """``taction netlist``."""

    files: list[str]
    deck: Word
    omissions: list[Omission]
    pruning: Pruning | None
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


class Power(Part):
    """Supply current, A, and dissipation at rest, W."""

    supply_current: Number
    quiescent: Number
    outputs: Number
    resistors: Number
    total: Number


class BomDocument(Document):
    """``taction bom``."""

    scene: str
    parts: list[Line]
    opamps: Packages
    power: Power
    not_listed: list[str]


class KicadDocument(Document):
    """``taction kicad``; `channel` and `row` count from 1."""

    scene: str
    files: list[str]
    channel: int
    row: int
    not_drawn: list[str]


class ExploreDocument(Document):
    """``taction explore``: where the page is, with its secret."""

    address: str


class SolveDocument(Document):
    """``taction solve``."""

    outcome: Outcome
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

    outcome: Outcome
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

    outcome: Outcome
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


class SceneFile(Part):
    """How a scene is written; `symbols` are short names of keys for ``--over``."""

    format: str
    quantities: str
    symbols: dict[str, str]
    example: str


class Example(Part):
    """A call with the files that it needs; `read` leads to the answer in its document."""

    task: str
    files: dict[str, str]
    call: str
    schema_: str = Field(alias="schema")
    read: list[str | int]


class FieldUse(Part):
    """A field of documents; null: it has no unit, or the field `unit` beside it has it."""

    unit: Word
    schemas: list[str]


class HelpDocument(Document):
    """``taction --json --help``."""

    program: str
    usage: str
    commands: list[Command]
    exit_statuses: dict[str, str]
    environment: dict[str, str]
    scene_file: SceneFile
    examples: list[Example]
    fields: dict[str, FieldUse]
    schemas: dict[str, Free]
    scene_schema: Free


class NewDocument(Document):
    """``taction new FILE``."""

    file: str


class NewMatrixDocument(ScaleDocument):
    """``taction new FILE --matrix``: the scene, its scalings and its verdict."""

    file: str
    lambda_rule: str
    recognised: list[str]
