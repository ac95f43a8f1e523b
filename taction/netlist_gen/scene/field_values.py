"""What a value of a scene may be: quantities, rules, ranges and names; pydantic is not needed."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taction.system.quantities import EXAMPLES, parse

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

LEAST, MOST = 1e-30, 1e30  # of a quantity in base units: no product of a few leaves the floats
BOTH_SIGNS = re.compile(r"^\s*(±|\+/?-)")
SMALL, LARGE = 1e-100, 1e100  # of a number without a unit


def plain_validator(check: Callable[[object], object]) -> CoreSchema:
    """Return the schema of pydantic for a value that `check` returns or refuses."""
    from pydantic_core import core_schema

    return core_schema.no_info_plain_validator_function(check)


@dataclass(frozen=True, slots=True)
class Unit:
    """Annotation of a quantity in `unit` above zero (with `zero`: or zero), or the `word`.

    A quantity of `both` signs may be written with the sign ±, also as +- or +/-. A `signed` one may
    be zero or negative.
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

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return plain_validator(self.check)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        example = f"a number in {self.unit}, or a quantity such as {self.example!r}"
        if self.word:
            example += f", or {self.word!r}"
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "description": example}


RANGE = re.compile(r"\s*([-+]?\d+(?:\.\d+)?)\s*\.\.\s*([-+]?\d+(?:\.\d+)?)\s*(?:deg|°)\s*C\s*")
COLDEST, HOTTEST = -55.0, 125.0  # degrees C, of parts


@dataclass(frozen=True, slots=True)
class TemperatureRange:
    """Annotation of two temperatures of a board, as ``"0..70degC"``."""

    def check(self, value: object) -> str:
        """Return the text as it is written; ValueError has the accepted values."""
        match = RANGE.fullmatch(value) if isinstance(value, str) else None
        ends = tuple(map(float, match.groups())) if match else ()
        if not ends or not COLDEST <= ends[0] <= ends[1] <= HOTTEST:
            text = f"between {COLDEST:g} and {HOTTEST:g} degrees C"
            raise ValueError(f"expected two temperatures, such as '0..70degC', {text}")
        return str(value)

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return plain_validator(self.check)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        return {"type": "string", "description": "two temperatures, such as '0..70degC'"}


@dataclass(frozen=True, slots=True)
class Rule:
    """Annotation of a positive number, or the name of a rule that finds the number."""

    names: tuple[str, ...]

    def check(self, value: object) -> float | str:
        """Return the number or the name; ValueError has the accepted values."""
        if isinstance(value, str) and value in self.names:
            return value
        if isinstance(value, int | float) and value is not True and SMALL <= value <= LARGE:
            return float(value)
        known = ", ".join(repr(name) for name in self.names)
        numbers = f"a number between {SMALL:g} and {LARGE:g}"
        raise ValueError(f"expected {numbers}, or one of the rules {known}")

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return plain_validator(self.check)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        return {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"enum": list(self.names)}]}


def in_range(value: float) -> float:
    """Return a number without a unit; ValueError for one whose products may leave the floats."""
    if value and not SMALL <= abs(value) <= LARGE:
        raise ValueError(f"out of range; expected 0, or a size between {SMALL:g} and {LARGE:g}")
    return value
