"""Tables of a scene: what a key accepts, all mistakes at once, and the schema of the same keys."""

from __future__ import annotations

import copy
import datetime
import math
import pickle
import random
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import jsonschema
import pytest

from taction.netlist_gen.scene.field_values import Number
from taction.netlist_gen.scene.fields import Model, NonNegative, Seconds, field
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.model import Kinds, MistakesError, TableForm
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import Complaint, InputError
from tests.support.paths import SCENES
from tests.support.running import python

BAD: tuple[Any, ...] = (
    "", "10pf", "10 p F", "1,5", "m", "-3", "12%", "nan", "auto", "1" * 200, "ideal",
    -1, 0, 2, 7.5, 200, 1e-200, 1e200, 10**30, math.inf, math.nan, True, False,
    [], {}, {"kind": "x"}, {"max": 1, "min": "2s"}, datetime.date(2020, 1, 1),
)  # fmt: skip
LOAD = {"kind": "cylinder", "force": 1.0}
WHOLE: dict[str, Any] = {
    "name": "board",
    "problem": {"kind": "tactile", "load": LOAD, "noise": {"seed": 2}},
    "design": {"capacitance": "10pF", "opamp": {"base": "tl084"}, "antilog": {"stage": "ideal"}},
    "analysis": {"engine": "auto"},
    "checks": {"rise_time": {"max": "1us"}, "noise": "1mV", "overshoot": {"max": 0.2}},
    "tolerances": {"parts": {"Rf_1_1": 0.01}},
    "regression": {"levels": {}, "times": {}, "poles": {}, "waveforms": {}},
}
CSV = {"problem": {"kind": "tactile", "load": {"kind": "csv", "file": "a.csv"}}}
MATRIX = {"problem": {"kind": "matrix", "matrix": "a.csv", "strain": "b.csv", "stress": "c.csv"}}


def complaints(data: dict[str, Any]) -> list[Complaint]:
    try:
        parse_scene(data, "x.toml")
    except InputError as error:
        return list(error.complaints)
    return []


def paths(model: Any, data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield every key that a scene of these kinds may have."""
    for key in model.model_fields.values():
        yield (*path, key.alias)
        inside = data.get(key.alias) if isinstance(data, dict) else None
        form = getattr(key.form, "inner", key.form)
        if isinstance(form, Kinds):
            form = TableForm(form.of[(inside or {}).get("kind", "cylinder")])
        if isinstance(form, TableForm):
            yield from paths(form.model, inside, (*path, key.alias))


def changed(data: dict[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """A copy with another value; a table that a plain value stands for is made."""
    made: dict[str, Any] = copy.deepcopy(data)
    inside = made
    for key in path[:-1]:
        if not isinstance(inside.get(key), dict):
            inside[key] = {}
        inside = inside[key]
    inside[path[-1]] = copy.deepcopy(value)
    return made


@pytest.mark.parametrize("data", [WHOLE, CSV, MATRIX], ids=["all tables", "csv load", "matrix"])
def test_every_key_with_bad_values(data: dict[str, Any]) -> None:
    """What a scene accepts its schema accepts, and a complaint is about the key, or one in it."""
    schema = jsonschema.Draft202012Validator(Scene.model_json_schema())
    draw = random.Random(7)  # noqa: S311
    assert complaints(data) == []
    refused = 0
    for path in paths(Scene, data):
        for value in draw.sample(BAD, 8):
            wrong = changed(data, path, value)
            found = complaints(wrong)
            if not found:
                assert schema.is_valid(wrong), (path, value)
            for each in found:
                known = (".".join(path), ".".join(path[:-1]), f"{path[0]}.", "problem.kind")
                assert each.key.startswith(known), (path, value, each)
                assert each.accepted
            refused += bool(found)
    assert refused > 100


def test_what_the_schema_refuses_is_refused() -> None:
    """Of plain numbers, words and truth values the schema says all that single keys accept."""
    schema = jsonschema.Draft202012Validator(Scene.model_json_schema())
    refused = 0
    for path in paths(Scene, WHOLE):
        for value in (-1, 0.0, 0.5, 2, 7.5, 1e6, True, "ideal", "E24", [], {"kind": "x"}):
            wrong = changed(WHOLE, path, value)
            if not schema.is_valid(wrong):
                refused += 1
                assert complaints(wrong), (path, value)
    assert refused > 300


def test_several_mistakes_at_once() -> None:
    draw = random.Random(25)  # noqa: S311
    every = list(paths(Scene, WHOLE))
    several = 0
    for _ in range(300):
        wrong = WHOLE
        for _ in range(draw.randint(2, 5)):
            path = draw.choice(every)
            if draw.random() < 0.3:
                path = (*path[:-1], path[-1] + "x")
            wrong = changed(wrong, path, draw.choice(BAD))
        several += len(complaints(wrong)) > 1
    assert several > 100


def test_a_refused_file_is_refused_soon(tmp_path: Any) -> None:
    board = (SCENES / "paper-breadboard.toml").read_text("utf-8")
    for name, old, new in (("key", "capacitance =", "capacitence ="), ("quote", '"10pF"', '"10pF')):
        file = tmp_path / f"{name}.toml"
        file.write_text(board.replace(old, new, 1), "utf-8")
        code = (
            "import sys; from taction.cli.main import main\n"
            f"try: main(['verify', {str(file)!r}])\n"
            "except SystemExit as end: assert end.code == 2, end\n"
            "heavy = {'numpy', 'rich'} & set(sys.modules)\n"
            "sys.exit(repr(heavy) if heavy else 0)"
        )
        done = python("-c", code)
        assert done.returncode == 0, done.stderr
        with pytest.raises(InputError):
            load_scene(file)


class Pulse(Model):
    """A pulse, or its height alone."""

    PLAIN, PLAIN_TYPES = "height", (int, float, str)

    height: Annotated[NonNegative, Number(lt=1)] = field(description="of its top")
    rise: Seconds | None = None
    shape: Literal["even", "odd"] = field("even", alias="form")


class Train(Model):
    """Pulses."""

    first: Pulse = Pulse(height=0.5)
    others: dict[str, NonNegative] = field({}, description="heights by name")
    wait: NonNegative | Literal["auto"] = "auto"


def test_a_table_has_its_values_and_defaults() -> None:
    train = Train.model_validate({"first": {"height": 0.25, "rise": "2ms", "form": "odd"}})
    assert (train.first.height, train.first.rise, train.first.shape) == (0.25, 2e-3, "odd")
    assert (train.others, train.wait, Train().first.height) == ({}, "auto", 0.5)
    assert train.model_fields_set == {"first"}
    assert Train.model_validate({"first": 0.1}).first == Pulse(height=0.1)
    assert repr(Pulse(height=0)) == "Pulse(height=0.0, rise=None, shape='even')"


def test_plain_data_of_a_table() -> None:
    train = Train(first=0.25, others={"a": 1})
    assert train.model_dump(exclude_unset=True) == {"first": {"height": 0.25}, "others": {"a": 1}}
    first = {"height": 0.25, "rise": None, "form": "even"}
    assert train.model_dump(by_alias=True)["first"] == first
    assert train.model_dump(include={"wait"}) == {"wait": "auto"}
    assert train.model_dump(exclude={"first", "others"}) == {"wait": "auto"}
    assert "rise" not in train.first.model_dump(exclude_none=True)


def test_copies_are_equal_and_frozen() -> None:
    pulse = Pulse(height=0.25)
    moved = pulse.model_copy({"height": 0.5})
    assert moved == Pulse(height=0.5) != pulse
    assert hash(moved) == hash(Pulse(height=0.5))
    assert pickle.loads(pickle.dumps(moved)) == copy.deepcopy(moved) == moved  # noqa: S301
    assert moved.model_fields_set == {"height"}
    with pytest.raises(AttributeError, match="Pulse is frozen"):
        pulse.height = 0.75


@pytest.mark.parametrize(
    ("data", "text"),
    [
        ({"first": {}}, "first.height: required; of its top"),
        (
            {"first": {"height": 25}},
            "first.height = 25: must be below 1; it is a fraction: 25 % is",
        ),
        ({"first": "5%"}, "first = '5%': expected a plain number, without quotes or unit; 5 % is"),
        ({"first": {"height": 0, "shape": "odd"}}, "first.shape = 'odd': unknown key; known here"),
        ({"others": {"a": -1}}, "others.a = -1: must be 0 or more"),
        ({"others": 1}, "others = 1: expected a table"),
        ({"wait": "late"}, "wait = 'late': expected one of 'auto'"),
        ({"wait": True}, "wait = True: expected a plain number, without quotes or unit"),
        (3, "scene = 3: expected a table"),
    ],
)
def test_mistakes_have_their_place(data: Any, text: str) -> None:
    with pytest.raises(MistakesError) as caught:
        Train.model_validate(data)
    assert text in str(caught.value)


def test_the_schema_of_a_table() -> None:
    schema = Train.model_json_schema()
    number, pulse = schema["$defs"]["Pulse"]["anyOf"]
    assert number == {"type": "number", "minimum": 0, "exclusiveMaximum": 1}
    assert pulse["required"] == ["height"]
    assert pulse["properties"].keys() == {"height", "rise", "form"}
    validator = jsonschema.Draft202012Validator(schema)
    assert validator.is_valid({"first": 0.5, "wait": "auto", "others": {"a": 2}})
    for wrong in ({"first": 1}, {"first": {"height": -1}}, {"wait": "x"}, {"others": {"a": -1}}):
        assert not validator.is_valid(wrong)
