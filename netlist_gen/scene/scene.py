"""`Scene`: everything that is asked for, frozen, read from TOML and proved on the way in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    StrictBool,
    model_validator,
)
from pydantic_core import CoreSchema

from netlist_gen.scene.fields import (
    Count,
    Farads,
    FaradsOrZero,
    FileName,
    Hertz,
    LambdaOrRule,
    Model,
    NonNegative,
    Ohms,
    OhmsOrZero,
    Positive,
    Real,
    Seconds,
    SecondsOrAuto,
    Seed,
    Siemens,
    Volts,
)
from netlist_gen.scene.regression import Regression
from netlist_gen.scene.tolerances import Tolerances
from spice_models.amplifier import AMPLIFIERS
from spice_models.definitions import SETTLING_BAND
from spice_models.presets import preset_names

NAME_PATTERN = r"^[A-Za-z0-9_.-]+$"
DEFAULT_RESISTANCE = 1.786e6


class CylinderLoad(Model):
    """Stress under a cylinder, eq (18): ``p/(pi a²) sqrt(a² - y²)`` as printed."""

    kind: Literal["cylinder"] = "cylinder"
    force: NonNegative = Field(3.0, description="p, force per unit length")
    half_width: Positive = Field(1.0, description="a, half width of the contact")
    centre: Real = Field(0.0, description="y of the contact's middle")
    normalised: StrictBool = Field(False, description="true: Hertz, 2p/(pi a²), integrates to p")


class CsvLoad(Model):
    """Stress profile from a CSV file beside the scene: columns y and stress."""

    kind: Literal["csv"]
    file: FileName = Field(description="CSV with two columns, y and stress; y increasing")


class Noise(Model):
    """Gaussian noise added to the strain."""

    variance: NonNegative = 0.0
    seed: Seed = 1


def _cylinder_by_default(value: object) -> object:
    """Every key has a default but problem.kind, so a load without a kind is a cylinder."""
    if isinstance(value, dict) and "kind" not in value:
        return {"kind": "cylinder", **value}
    return value


AnyLoad = Annotated[CylinderLoad | CsvLoad, Field(discriminator="kind")]


class TactileProblem(Model):
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


class MatrixProblem(Model):
    """A matrix and a strain vector from files beside the scene."""

    kind: Literal["matrix"]
    matrix: FileName = Field(description="M rows, N columns; .csv or .npy")
    strain: FileName = Field(description="M values; .csv or .npy")
    stress: FileName | None = Field(None, description="N values, the truth, where it is known")
    noise: Noise = Noise()


class OpAmpChoice(Model):
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


class Design(Model):
    """The board's components."""

    topology: Literal["integrator", "passive"] = "integrator"
    amplifier: Literal["linear", "exponential", "sinh", "softplus", "tanh"] = "linear"
    capacitance: Farads = 1e-11
    resistance: Ohms | None = None
    lam: LambdaOrRule | None = Field(
        None, alias="lambda", description="regularisation parameter, or the rule that chooses it"
    )
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


class AnalysisChoice(Model):
    """How the board is analysed."""

    engine: Literal["auto", "ngspice", "statespace"] = "auto"
    stop: SecondsOrAuto = "auto"
    initial: Literal["zero", "rest"] = "zero"
    points_per_period: Annotated[Real, Field(ge=8, le=10_000)] | None = Field(
        None,
        description="time points in one period of the fastest ringing mode that matters; by default"
        " 125, or as many as 'error' needs",
    )
    error: Annotated[Positive, Field(lt=1)] | None = Field(
        None, description="largest error of the transient, fraction of the step amplitude"
    )
    timeout: Seconds = 600.0

    @model_validator(mode="after")
    def _one_resolution(self) -> Self:
        if self.error is not None and self.points_per_period is not None:
            raise ValueError("'error' excludes 'points_per_period', which follows from it")
        return self


class SteadyStateCheck(Model):
    """Final outputs against the reference, as a fraction of the step amplitude."""

    tolerance: Positive = 1e-3


class SettlingTimeCheck(Model):
    """Settling to ``±band`` (a fraction of the step amplitude) within `max`."""

    band: Annotated[Positive, Field(lt=1)] = SETTLING_BAND
    max: Seconds | None = None


class OvershootCheck(Model):
    """Overshoot as a fraction of the step amplitude."""

    max: NonNegative = Field(description="fraction of the step amplitude")


class RiseTimeCheck(Model):
    """10-90 % rise time of one channel; the middle one where none is named."""

    max: Seconds | None = None
    min: Seconds | None = None
    channel: Count | None = None


class StabilityCheck(Model):
    """`margin`: by what factor C may shrink before the board oscillates; 1: stable as it is."""

    margin: Annotated[Real, Field(ge=1)] = 1.0


class EnginesAgreeCheck(Model):
    """Largest difference between ngspice and the state-space engine, over all time.

    Without a tolerance, 1e-3 of the step amplitude, judged only where both engines run anyway.
    """

    tolerance: Positive | None = None


class Checks(Model):
    """What must hold."""

    steady_state: SteadyStateCheck = SteadyStateCheck()
    settling_time: SettlingTimeCheck = SettlingTimeCheck()
    overshoot: OvershootCheck | None = None
    rise_time: RiseTimeCheck | None = None
    stability: StabilityCheck = StabilityCheck()
    engines_agree: EnginesAgreeCheck = EnginesAgreeCheck()


class Scene(Model):
    """Everything asked for. `folder` is where the files that it names are."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)] = "scene"
    problem: Annotated[TactileProblem | MatrixProblem, Field(discriminator="kind")] = Field(
        description="a table with kind = 'tactile' or 'matrix'"
    )
    design: Design = Design()
    analysis: AnalysisChoice = AnalysisChoice()
    checks: Checks = Checks()
    tolerances: Tolerances = Tolerances()
    regression: Regression = Regression()
    _file: Path = PrivateAttr(Path("scene.toml"))
    _lambda_rule: str = PrivateAttr("")

    @property
    def file(self) -> Path:
        """Where the scene was read."""
        return self._file

    @property
    def lambda_rule(self) -> str:
        """The rule that chose lambda; empty where the scene gave a number."""
        return self._lambda_rule

    def with_lambda(self, lam: float, rule: str) -> Scene:
        """Return the scene with the lambda that `rule` chose."""
        design = self.design.model_copy(update={"lam": lam})
        chosen = self.model_copy(update={"design": design})
        chosen._lambda_rule = rule
        return chosen

    @property
    def folder(self) -> Path:
        """Folder of the scene file."""
        return self._file.parent
