"""What a value of a scene may be: annotations of fields, each with a check and a JSON Schema.

An annotation has ``check(value)``, which returns the value as the scene keeps it, or raises a
ValueError whose text says what is accepted, and ``schema()``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from taction.system.quantities import EXAMPLES, parse

LEAST, MOST = 1e-30, 1e30  # of a quantity in base units: no product of a few leaves the floats
BOTH_SIGNS = re.compile(r"^\s*(±|\+/?-)")
SMALL, LARGE = 1e-100, 1e100  # of a number without a unit


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

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
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

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
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

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        return {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"enum": list(self.names)}]}


@dataclass(frozen=True, slots=True)
class Number:
    """Annotation of a plain number between limits, a `whole` one or any; two of them add up."""

    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    whole: bool = False

    def check(self, value: object) -> float:
        """Return the number; ValueError has the accepted values. "7" and true are no numbers."""
        kinds = int if self.whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds):
            kind = "plain whole number" if self.whole else "plain number"
            raise ValueError(f"expected a {kind}, without quotes or unit")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError("expected a finite number")
        if not self.whole and value and not SMALL <= abs(value) <= LARGE:
            size = f"expected 0, or a size between {SMALL:g} and {LARGE:g}"
            raise ValueError(f"out of range; {size}")  # products of larger ones leave the floats
        if self.le is not None and value > self.le:
            raise ValueError(f"must be {self.le:g} or less")
        if self.lt is not None and value >= self.lt:
            share = f"; it is a fraction: {value:g} % is {value / 100.0:g}"
            raise ValueError(f"must be below {self.lt:g}{share if 1 <= value <= 100 else ''}")
        if self.ge is not None and value < self.ge:
            raise ValueError(f"must be {self.ge:g} or more")
        if self.gt is not None and value <= self.gt:
            raise ValueError(f"must be above {self.gt:g}")
        return value if self.whole else float(value)

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        limits = {
            "exclusiveMinimum": self.gt,
            "minimum": self.ge,
            "exclusiveMaximum": self.lt,
            "maximum": self.le,
        }
        kind = "integer" if self.whole else "number"
        return {"type": kind} | {k: limit for k, limit in limits.items() if limit is not None}


@dataclass(frozen=True, slots=True)
class ShortText:
    """Annotation of a text with a least and a largest length, and perhaps a pattern."""

    least: int = 0
    most: int | None = None
    pattern: str = ""

    def check(self, value: object) -> str:
        """Return the text; ValueError has the accepted values."""
        if not isinstance(value, str):
            raise ValueError("expected text in quotes")
        if len(value) < self.least:
            raise ValueError("expected text that is not empty")
        if self.most is not None and len(value) > self.most:
            raise ValueError(f"expected at most {self.most} characters")
        if self.pattern and not re.search(self.pattern.replace("$", r"\Z"), value):
            raise ValueError("letters, digits, '-', '_' and '.' only")
        return value

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        limits = {"minLength": self.least, "maxLength": self.most, "pattern": self.pattern}
        return {"type": "string"} | {name: limit for name, limit in limits.items() if limit}


@dataclass(frozen=True, slots=True)
class Words:
    """Annotation of one of some words."""

    names: tuple[str, ...]

    def check(self, value: object) -> str:
        """Return the word; ValueError has the accepted ones."""
        if isinstance(value, str) and value in self.names:
            return value
        *others, last = map(repr, self.names)
        known = f"{', '.join(others)} or {last}" if others else last
        raise ValueError(f"expected one of {known}")

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        several = {"enum": list(self.names)} if len(self.names) > 1 else {"const": self.names[0]}
        return {**several, "type": "string"}


@dataclass(frozen=True, slots=True)
class Truth:
    """Annotation of true or false."""

    def check(self, value: object) -> bool:
        """Return the truth value; ValueError for anything else."""
        if not isinstance(value, bool):
            raise ValueError("expected true or false")
        return value

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        return {"type": "boolean"}
