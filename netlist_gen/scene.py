"""`Scene`: everything that is asked for, frozen, read from TOML and proved on the way in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    StrictBool,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from netlist_gen.quantities import EXAMPLES, parse
from spice_models.amplifier import AMPLIFIERS
from spice_models.presets import preset_names

NAME_PATTERN = r"^[A-Za-z0-9_.-]+$"
DEFAULT_RESISTANCE = 1.786e6


@dataclass(frozen=True, slots=True)
class Unit:
    """Annotation of a field that holds a quantity in `unit`: ``"10pF"`` or a number.

    `zero` accepts zero too, and a `word` stands for itself.
    """

    unit: str
    zero: bool = False
    word: str = ""

    def check(self, value: object) -> float | str:
        """Return the quantity in base units; ValueError says what would be accepted."""
        if self.word and value == self.word:
            return self.word
        try:
            number = parse(value, self.unit)
        except ValueError as error:
            raise ValueError(f"{error}, or {self.word!r}" if self.word else str(error)) from None
        if number < 0 or (number == 0 and not self.zero):
            raise ValueError(f"must be {'zero or more' if self.zero else 'above zero'}")
        return number

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        example = f"a number in {self.unit}, or a quantity such as {EXAMPLES[self.unit]!r}"
        if self.word:
            example += f", or {self.word!r}"
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "description": example}


Farads = Annotated[float, Unit("F")]
FaradsOrZero = Annotated[float, Unit("F", zero=True)]
Ohms = Annotated[float, Unit("ohm")]
OhmsOrZero = Annotated[float, Unit("ohm", zero=True)]
Siemens = Annotated[float, Unit("S")]
Volts = Annotated[float, Unit("V")]
Hertz = Annotated[float, Unit("Hz")]
Seconds = Annotated[float, Unit("s")]
SecondsOrAuto = Annotated[Literal["auto"] | float, Unit("s", word="auto")]


def _no_text(value: object) -> object:
    """Refuse "7" for 7: TOML has numbers, and a quoted one is a slip worth naming."""
    if isinstance(value, str | bool):
        raise ValueError("expected a plain number, without quotes or unit")
    return value


Real = Annotated[float, BeforeValidator(_no_text), Field(allow_inf_nan=False)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Count = Annotated[int, BeforeValidator(_no_text), Field(ge=1, le=100_000)]
Seed = Annotated[int, BeforeValidator(_no_text), Field(ge=0)]
FileName = Annotated[str, Field(min_length=1)]


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class CylinderLoad(_Model):
    """Stress under a cylinder, eq (18): ``p/(pi a²) sqrt(a² - y²)`` as printed."""

    kind: Literal["cylinder"] = "cylinder"
    force: NonNegative = Field(3.0, description="p, force per unit length")
    half_width: Positive = Field(1.0, description="a, half width of the contact")
    centre: Real = Field(0.0, description="y of the contact's middle")
    normalised: StrictBool = Field(False, description="true: Hertz, 2p/(pi a²), integrates to p")


class CsvLoad(_Model):
    """Stress profile from a CSV file beside the scene: columns y and stress."""

    kind: Literal["csv"]
    file: FileName = Field(description="CSV with two columns, y and stress; y increasing")


class Noise(_Model):
    """Gaussian noise added to the strain."""

    variance: NonNegative = 0.0
    seed: Seed = 1


def _cylinder_by_default(value: object) -> object:
    """Every key has a default but problem.kind, so a load without a kind is a cylinder."""
    if isinstance(value, dict) and "kind" not in value:
        return {"kind": "cylinder", **value}
    return value


AnyLoad = Annotated[CylinderLoad | CsvLoad, Field(discriminator="kind")]


class TactileProblem(_Model):
    """Strain under an elastic layer, eqs (1) to (4), with the corrected kernels."""

    kind: Literal["tactile"]
    channels: Count = Field(7, description="N, points where stress is reconstructed")
    sensors: Count | None = Field(None, description="M, where it differs from N")
    span: Positive = Field(6.0, description="y_max - y_min, in the unit of depth")
    depth: Positive = Field(1.0, description="x")
    modulus: Positive = Field(1.0, description="E")
    poisson: Annotated[Real, Field(ge=-1.0, le=0.5)] = Field(0.5, description="nu")
    kernel: Literal["normal", "tangential"] = "normal"
    quadrature: Literal["none", "rectangle"] = Field(
        "none", description="none: as eq (4) is printed; rectangle: times the spacing"
    )
    load: Annotated[AnyLoad, BeforeValidator(_cylinder_by_default)] = CylinderLoad()
    noise: Noise = Noise()


class MatrixProblem(_Model):
    """A matrix and a strain vector from files beside the scene."""

    kind: Literal["matrix"]
    matrix: FileName = Field(description="M rows, N columns; .csv or .npy")
    strain: FileName = Field(description="M values; .csv or .npy")
    stress: FileName | None = Field(None, description="N values, the truth, where it is known")
    noise: Noise = Noise()


class OpAmpChoice(_Model):
    """A preset, or a preset with some figures changed."""

    base: str = "ua741"
    dc_gain: Positive | None = None
    gbw: Hertz | None = None
    second_pole: Hertz | None = None
    phase_margin: Annotated[Real, Field(gt=0, lt=90)] | None = Field(
        None, description="degrees, at unity gain; sets the second pole"
    )
    input_resistance: Ohms | None = None
    differential_capacitance: FaradsOrZero | None = None
    input_capacitance: FaradsOrZero | None = None
    output_resistance: OhmsOrZero | None = None

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, data: Any) -> Any:
        return {"base": data} if isinstance(data, str) else data

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        table = handler(core)
        return {"anyOf": [{"type": "string", "enum": list(preset_names())}, table]}


def contradictions(design: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the keys of a design that others exclude, each with the reason."""
    if design.get("lambda") is not None and design.get("resistance") is not None:
        yield "lambda", "excludes 'resistance': give one of the two"
    if design.get("amplifier", "linear") == "linear":
        for key in ("exponential_slope", "bias"):
            if design.get(key) is not None:
                yield key, "needs a nonlinear amplifier, such as 'exponential'"


class Design(_Model):
    """The board's components."""

    topology: Literal["integrator", "passive"] = "integrator"
    amplifier: Literal["linear", "exponential", "sinh", "softplus", "tanh"] = "linear"
    capacitance: Farads = 1e-11
    resistance: Ohms | None = None
    lam: Positive | None = Field(None, alias="lambda", description="regularisation parameter")
    gain: Ohms = 6.252e6
    unit_conductance: Siemens = 3.313e-7
    unit_voltage: Volts = 1.0
    exponential_slope: Volts | None = None
    bias: StrictBool | None = Field(None, description="bias current I_b = Ve/R")
    opamp: OpAmpChoice = OpAmpChoice()
    stray_capacitance: FaradsOrZero = 1e-11
    inverter_resistance: Ohms = 1e4
    resistor_series: Literal["exact", "E24", "E96", "E192"] = "exact"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for key, reason in contradictions(self.model_dump(by_alias=True)):
            raise ValueError(f"'{key}' {reason}")
        return self

    @property
    def biased(self) -> bool:
        """Whether a bias current flows; where the scene does not say, the amplifier's kind does."""
        return AMPLIFIERS[self.amplifier].biased if self.bias is None else self.bias


class AnalysisChoice(_Model):
    """How the board is analysed."""

    engine: Literal["auto", "ngspice", "statespace"] = "auto"
    stop: SecondsOrAuto = "auto"
    initial: Literal["zero", "rest"] = "zero"
    points_per_period: Annotated[Real, Field(ge=8, le=10_000)] = Field(
        125, description="time points in one period of the fastest ringing mode that matters"
    )
    timeout: Seconds = 600.0


class SteadyStateCheck(_Model):
    """Final outputs against the reference, as a fraction of the step amplitude."""

    tolerance: Positive = 1e-3


class SettlingTimeCheck(_Model):
    """Settling to ``±band`` (a fraction of the step amplitude) within `max`."""

    band: Annotated[Positive, Field(lt=1)] = 0.01
    max: Seconds | None = None


class OvershootCheck(_Model):
    """Overshoot as a fraction of the step amplitude."""

    max: NonNegative = Field(description="fraction of the step amplitude")


class RiseTimeCheck(_Model):
    """10-90 % rise time of one channel; the middle one where none is named."""

    max: Seconds | None = None
    min: Seconds | None = None
    channel: Count | None = None


class StabilityCheck(_Model):
    """`margin`: by what factor C may shrink before the board oscillates; 1: stable as it is."""

    margin: Annotated[Real, Field(ge=1)] = 1.0


class EnginesAgreeCheck(_Model):
    """Largest difference between ngspice and the state-space engine, over all time."""

    tolerance: Positive = 1e-3


class Checks(_Model):
    """What must hold."""

    steady_state: SteadyStateCheck = SteadyStateCheck()
    settling_time: SettlingTimeCheck = SettlingTimeCheck()
    overshoot: OvershootCheck | None = None
    rise_time: RiseTimeCheck | None = None
    stability: StabilityCheck = StabilityCheck()
    engines_agree: EnginesAgreeCheck = EnginesAgreeCheck()


class Scene(_Model):
    """Everything asked for. `folder` is where the files that it names are."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)] = "scene"
    problem: Annotated[TactileProblem | MatrixProblem, Field(discriminator="kind")] = Field(
        description="a table with kind = 'tactile' or 'matrix'"
    )
    design: Design = Design()
    analysis: AnalysisChoice = AnalysisChoice()
    checks: Checks = Checks()
    _file: Path = PrivateAttr(Path("scene.toml"))

    @property
    def file(self) -> Path:
        """Where the scene was read."""
        return self._file

    @property
    def folder(self) -> Path:
        """Folder of the scene file."""
        return self._file.parent
