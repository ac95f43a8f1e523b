"""Plain data, the way back, the schema and the units of a type."""

from __future__ import annotations

import enum
import json
import math
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import jsonschema
import pytest

from taction.system.documents import (
    HIDDEN,
    INLINE,
    Seconds,
    plain,
    read,
    schema,
    units,
)


class Colour(enum.Enum):
    """A word."""

    RED = "red"


@dataclass(frozen=True)
class Inner:
    """The inner part."""

    time: Seconds
    level: Annotated[float, "V"] = 0.0


@dataclass(frozen=True)
class Beside:
    """Stands beside the fields of its owner."""

    word: Literal["a", "b"]


@dataclass(frozen=True)
class Outer:
    """The outer part.

    More about it.
    """

    SHOWN: ClassVar[tuple[str, ...]] = ("twice",)

    lam: Annotated[float, {"key": "lambda"}, {"note": "never 0"}]
    colour: Colour
    inner: tuple[Inner, ...]
    beside: Annotated[Beside, INLINE]
    numbers: Annotated[dict[str, float | None], {"inline": {"gain": "ohm", "factor": ""}}]
    free: dict[str, Any]
    secret: Annotated[object, HIDDEN] = None
    maybe: int | None = None
    rates: Annotated[list[float], "1/s"] = field(default_factory=list)

    @property
    def twice(self) -> Annotated[float, "s"]:
        """A property that is shown."""
        return 2.0 * self.lam


OUTER = Outer(
    0.5,
    Colour.RED,
    (Inner(1e-6), Inner(None, 2.0)),
    Beside("a"),
    {"gain": 1e4, "factor": None},
    {"x": [1]},
    secret=object(),
)
DATA = {
    "lambda": 0.5,
    "colour": "red",
    "inner": [{"time": 1e-6, "level": 0.0}, {"time": None, "level": 2.0}],
    "word": "a",
    "gain": 1e4,
    "factor": None,
    "free": {"x": [1]},
    "maybe": None,
    "rates": [],
    "twice": 1.0,
}


def test_plain_data_of_a_type() -> None:
    assert plain(OUTER) == DATA
    json.dumps(plain(OUTER), allow_nan=False)


def test_the_way_back() -> None:
    back = read(Outer, json.loads(json.dumps(DATA)))
    assert plain(back) == DATA
    assert back.inner[1] == Inner(None, 2.0)
    assert back.secret is None


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"lambda": "0.5"}, "lambda = '0.5': expected a finite number"),
        ({"lambda": True}, "lambda = True: expected a finite number"),
        ({"lambda": math.inf}, "lambda = inf: expected a finite number"),
        ({"word": "c"}, "word = 'c': expected one of 'a', 'b'"),
        ({"inner": [{"level": 1.0}]}, r"inner\[0\].time: missing"),
        ({"inner": 3}, "inner = 3: expected a list"),
        ({"free": []}, "free = a list of 0: expected a table"),
        ({"maybe": 1.5}, "maybe = 1.5: expected a whole number"),
        ({"colour": "blue"}, "colour = 'blue': expected one of 'red'"),
    ],
)
def test_wrong_data_are_refused_with_their_place(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        read(Outer, DATA | change)


def test_plain_data_fit_the_schema_and_nothing_else_does() -> None:
    found = schema(Outer)
    jsonschema.Draft202012Validator.check_schema(found)
    jsonschema.validate(DATA, found)
    for wrong in (DATA | {"more": 1}, DATA | {"word": "c"}, {**DATA, "gain": "1"}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, found)
    less = {name: value for name, value in DATA.items() if name != "factor"}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(less, found)
    assert found["description"] == "The outer part."
    assert found["properties"]["lambda"]["description"] == "never 0"
    assert found["properties"]["gain"]["unit"] == "ohm"
    assert "secret" not in found["properties"]


def test_units_of_a_type() -> None:
    assert units(Outer) == {
        "gain": "ohm",
        "level": "V",
        "rates": "1/s",
        "time": "s",
        "twice": "s",
    }
