"""Types of a scene's fields: quantities with units, plain numbers, and the base of the tables."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PlainValidator,
    StrictBool,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from taction.system.quantities import EXAMPLES, parse

LEAST, MOST = 1e-30, 1e30  # of a quantity in base units: no product of a few leaves the floats
BOTH_SIGNS = re.compile(r"^\s*(±|\+/?-)")
SMALL, LARGE = 1e-100, 1e100  # of a number without a unit


class Checked:
    """Annotation of a value that `check` accepts; `described` is its JSON Schema."""

    __slots__ = ()

    def check(self, value: Any) -> Any:
        """Return the value as it is kept; ValueError has the accepted values."""
        raise NotImplementedError

    def described(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        return self.described()


@dataclass(frozen=True, slots=True)
class Unit(Checked):
    """Annotation of a quantity in `unit` above zero (with `zero`: or zero), or the `word`.

    One of `both` signs may be written with ±, +- or +/-. A `signed` one may be zero or negative.
    """

    unit: str
    zero: bool = False
    word: str = ""
    both: bool = False
    signed: bool = False

    @property
    def example(self) -> str:
        """A quantity as a scene has it."""
        return "±15V" if self.both else EXAMPLES[self.unit]

    def check(self, value: object) -> float | str:
        """Return the quantity in base units, or the word; ValueError has the accepted values."""
        if self.word and value == self.word:
            return self.word
        if self.both and isinstance(value, str):
            value = BOTH_SIGNS.sub("", value)
        try:
            number = parse(value, self.unit)
        except ValueError as error:
            text = str(error).replace(repr(EXAMPLES[self.unit]), repr(self.example))
            raise ValueError(f"{text}, or {self.word!r}" if self.word else text) from None
        if number and not LEAST <= abs(number) <= MOST:
            raise ValueError(f"out of range; expected between {LEAST:g} and {MOST:g} {self.unit}")
        if not self.signed and (number < 0 or (number == 0 and not self.zero)):
            raise ValueError(f"must be {'zero or more' if self.zero else 'above zero'}")
        return number

    def described(self) -> dict[str, Any]:
        """Return the schema of the written values."""
        example = f"a number in {self.unit}, or a quantity such as {self.example!r}"
        if self.word:
            example += f", or {self.word!r}"
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "description": example}


RANGE = re.compile(r"\s*([-+]?\d+(?:\.\d+)?)\s*\.\.\s*([-+]?\d+(?:\.\d+)?)\s*(?:deg|°)\s*C\s*")
COLDEST, HOTTEST = -55.0, 125.0  # degrees C, of parts


def _temperatures(value: object) -> str:
    match = RANGE.fullmatch(value) if isinstance(value, str) else None
    ends = tuple(map(float, match.groups())) if match else ()
    if not ends or not COLDEST <= ends[0] <= ends[1] <= HOTTEST:
        text = f"between {COLDEST:g} and {HOTTEST:g} degrees C"
        raise ValueError(f"expected two temperatures, such as '0..70degC', {text}")
    return str(value)


def _lambda(value: object) -> float | str:
    if isinstance(value, str) and value in RULES:
        return value
    if isinstance(value, int | float) and value is not True and SMALL <= value <= LARGE:
        return float(value)
    known = ", ".join(map(repr, RULES))
    numbers = f"a number between {SMALL:g} and {LARGE:g}"
    raise ValueError(f"expected {numbers}, or one of the rules {known}")


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
RULES = ("discrepancy", "gcv")  # that find lambda
LambdaOrRule = Annotated[
    float | str,
    PlainValidator(_lambda),
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"enum": [*RULES]}]}),
]
TwoTemperatures = Annotated[
    str,
    PlainValidator(_temperatures),
    WithJsonSchema({"type": "string", "description": "two temperatures, such as '0..70degC'"}),
]


# Strict: "7" and true are mistakes, not numbers.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Flag = StrictBool
Count = Annotated[int, Field(strict=True, ge=1, le=MOST_CHANNELS)]
Seed = Annotated[int, Field(strict=True, ge=0)]
FileName = Annotated[str, Field(min_length=1)]


def entry(default: Any, description: str) -> Any:
    """Return a key of a table that has a default and a description."""
    return Field(default, description=description)


def optional(description: str) -> Any:
    """Return a key of a table that may be left out."""
    return Field(None, description=description)


class Model(BaseModel):
    """A table of the scene: frozen, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any) -> Any:
        """Refuse a number whose products may leave the floats; a quantity has its own limits."""
        if isinstance(value, float) and value and not SMALL <= abs(value) <= LARGE:
            text = f"out of range; expected 0, or a size between {SMALL:g} and {LARGE:g}"
            raise ValueError(text)
        return value


class Shortened(Model):
    """A table in whose place may stand the value of one key: ``settling_time = "10us"``."""

    PLAIN: ClassVar[str]  # this key

    @model_validator(mode="before")
    @classmethod
    def _plain_value(cls, data: Any) -> Any:
        return {cls.PLAIN: data} if isinstance(data, str | int | float) else data

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Return the schema of the table, or of the plain value."""
        table = handler(core)
        plain = handler.resolve_ref_schema(table)["properties"][cls.PLAIN]
        own = {key: value for key, value in plain.items() if key not in ("title", "default")}
        return {"anyOf": [own, table]}
