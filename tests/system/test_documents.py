"""Plain data, the way back, the schema and the units of a type; messages stay short."""

from __future__ import annotations

import enum
import json
import math
import pickle
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import jsonschema
import pytest

from taction.system import progress as after_result
from taction.system.documents import HIDDEN, INLINE, Seconds, plain, read, schema, units
from taction.system.errors import (
    MOST_LISTED,
    Complaint,
    DivergesError,
    InputError,
    SimulationError,
    TactionError,
)
from taction.system.processes import one_limit, time_left
from taction.system.progress import LONGEST, attempt
from taction.verification.studies.decks.foreign_board import read_board


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


def test_plain_data_of_a_type_and_the_way_back() -> None:
    assert plain(OUTER) == DATA
    back = read(Outer, json.loads(json.dumps(DATA, allow_nan=False)))
    assert plain(back) == DATA
    assert back.inner[1] == Inner(None, 2.0)
    assert back.secret is None
    assert units(Outer) == {"gain": "ohm", "level": "V", "rates": "1/s", "time": "s", "twice": "s"}


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


def test_a_message_lists_some_mistakes_and_counts_the_others() -> None:
    complaints = [Complaint(f"key{number}", "", "unknown") for number in range(1000)]
    error = InputError("scene.toml", *complaints)
    lines = str(error).splitlines()
    assert len(error.complaints) == 1000
    assert lines[0] == "scene.toml: key0: unknown"
    assert len(lines) == MOST_LISTED + 1
    assert lines[-1] == f"scene.toml: and {1000 - MOST_LISTED} more mistakes"


@pytest.mark.parametrize(
    "error",
    [
        InputError("scene.toml", Complaint("design.gain", "-1", "must be above 0")),
        DivergesError("the outputs leave every bound", partial="so far"),
        SimulationError("no vector", log="line 1"),
    ],
)
def test_a_pickled_error_keeps_its_text_and_attributes(error: TactionError) -> None:
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 - written in this line
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


def test_runs_share_what_is_left() -> None:
    with one_limit(100.0):
        assert 99.0 < time_left(1e3) <= 100.0
        assert time_left(5.0) == 5.0
        with one_limit(1e3):  # never later than the one around it
            assert time_left(1e3) <= 100.0
        with one_limit(50.0, more=True):
            assert 149.0 < time_left(1e3) <= 150.0
        assert time_left(1e3) <= 100.0
    assert time_left(1e3) == 1e3


@pytest.mark.parametrize("card", ["R2 out 0 1k", "D1 out 0 dx\n.model dx d(is=1f)"])
def test_no_run_begins_when_the_time_is_over(card: str, ngspice: str, tmp_path: Path) -> None:
    deck = tmp_path / "a.cir"
    deck.write_text(f"t\nV1 in 0 1\nR1 in out 1k\n{card}\nC1 out 0 1n\n.end\n")
    begin = time.process_time()
    with one_limit(0.0), pytest.raises(InputError, match="all runs of ngspice have together is"):
        read_board(deck)
    assert time.process_time() - begin < 2.0


def test_a_step_that_fails_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))
    told: list[str] = []

    def step() -> int:
        raise ValueError("two\nlines " + "x" * 10_000)

    assert attempt("the step", step, 3, told.append) == 3
    assert told[0].startswith(r"the step failed, the result stands: ValueError: two\nlines x")
    assert len(told[0]) < LONGEST + 60
    assert attempt("the step", lambda: 4, 3, told.append) == 4
    assert len(told) == 1


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(2), BrokenPipeError()])
def test_what_is_no_failure_passes(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))

    def step() -> None:
        raise error

    with pytest.raises(type(error)):
        attempt("the step", step, None, print, lambda each: isinstance(each, OSError))
