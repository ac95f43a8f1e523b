"""Types of a scene's fields: quantities with units, plain numbers, and the base of the tables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import CoreSchema, core_schema

from netlist_gen.quantities import EXAMPLES, parse


@dataclass(frozen=True, slots=True)
class Unit:
    """Annotation of a quantity in `unit` above zero (with `zero`: or zero), or the `word`."""

    unit: str
    zero: bool = False
    word: str = ""

    def check(self, value: object) -> float | str:
        """Return the quantity in base units, or the word; ValueError has the accepted values."""
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


@dataclass(frozen=True, slots=True)
class Rule:
    """Annotation of a positive number, or the name of a rule that finds the number."""

    names: tuple[str, ...]

    def check(self, value: object) -> float | str:
        """Return the number or the name; ValueError has the accepted values."""
        if isinstance(value, str) and value in self.names:
            return value
        if isinstance(value, int | float) and value is not True and 0 < value < math.inf:
            return float(value)
        known = ", ".join(repr(name) for name in self.names)
        raise ValueError(f"expected a number above zero, or one of the rules {known}")

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        return {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"enum": list(self.names)}]}


Farads = Annotated[float, Unit("F")]
FaradsOrZero = Annotated[float, Unit("F", zero=True)]
Ohms = Annotated[float, Unit("ohm")]
OhmsOrZero = Annotated[float, Unit("ohm", zero=True)]
Siemens = Annotated[float, Unit("S")]
Volts = Annotated[float, Unit("V")]
Hertz = Annotated[float, Unit("Hz")]
Seconds = Annotated[float, Unit("s")]
SecondsOrAuto = Annotated[Literal["auto"] | float, Unit("s", word="auto")]
LambdaOrRule = Annotated[
    float | str, Rule(("discrepancy", "gcv", "l-curve", "quasi-optimality", "mse"))
]

# Strict: "7" and true are mistakes, not numbers.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Count = Annotated[int, Field(strict=True, ge=1, le=100_000)]
Seed = Annotated[int, Field(strict=True, ge=0)]
FileName = Annotated[str, Field(min_length=1)]


class Model(BaseModel):
    """A table of the scene: frozen, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")
