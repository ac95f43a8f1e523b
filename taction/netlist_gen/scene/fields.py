"""Types of a scene's fields: quantities with units, plain numbers, and the base of the tables."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from taction.netlist_gen.scene.field_values import Rule, Unit, in_range

MOST_CHANNELS = 5000  # T has 0.2 GB, and the analysis of the board takes many times that

Farads = Annotated[float, Unit("F")]
FaradsOrZero = Annotated[float, Unit("F", zero=True)]
Ohms = Annotated[float, Unit("ohm")]
OhmsOrZero = Annotated[float, Unit("ohm", zero=True)]
Siemens = Annotated[float, Unit("S")]
Volts = Annotated[float, Unit("V")]
VoltsOrZero = Annotated[float, Unit("V", zero=True)]
SignedVolts = Annotated[float, Unit("V", signed=True)]
SupplyVolts = Annotated[float, Unit("V", both=True)]
Amps = Annotated[float, Unit("A")]
SignedAmps = Annotated[float, Unit("A", signed=True)]
AmpsOrZero = Annotated[float, Unit("A", zero=True)]
Kelvins = Annotated[float, Unit("K")]
VoltsPerKelvinOrZero = Annotated[float, Unit("V/K", zero=True)]
AmpsPerKelvinOrZero = Annotated[float, Unit("A/K", zero=True)]
VoltsPerSecond = Annotated[float, Unit("V/s")]
VoltageDensityOrZero = Annotated[float, Unit("V/rtHz", zero=True)]
CurrentDensityOrZero = Annotated[float, Unit("A/rtHz", zero=True)]
Hertz = Annotated[float, Unit("Hz")]
HertzOrZero = Annotated[float, Unit("Hz", zero=True)]
Seconds = Annotated[float, Unit("s")]
SecondsOrAuto = Annotated[Literal["auto"] | float, Unit("s", word="auto")]
LambdaOrRule = Annotated[
    float | str, Rule(("discrepancy", "gcv", "l-curve", "quasi-optimality", "mse"))
]


# Strict: "7" and true are mistakes, not numbers.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False), AfterValidator(in_range)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Count = Annotated[int, Field(strict=True, ge=1, le=MOST_CHANNELS)]
Seed = Annotated[int, Field(strict=True, ge=0)]
FileName = Annotated[str, Field(min_length=1)]


class Model(BaseModel):
    """A table of the scene: frozen, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def model_json_schema(cls, *args: Any, **options: Any) -> dict[str, Any]:
        """Return the schema with the limits of numbers by the names that JSON Schema knows."""
        found: dict[str, Any] = _with_limits(super().model_json_schema(*args, **options))
        return found


# Behind a check of its own a limit keeps pydantic's name in the schema, which no editor knows.
LIMITS = {"ge": "minimum", "gt": "exclusiveMinimum", "le": "maximum", "lt": "exclusiveMaximum"}


def _with_limits(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_with_limits(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    return {LIMITS.get(name, name): _with_limits(value) for name, value in schema.items()}
