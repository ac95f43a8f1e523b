"""What is refused before the models are loaded is what the models refuse, word by word."""

from __future__ import annotations

import copy
import json
import math
import random
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest

from taction.netlist_gen.scene.key_mistakes import KEYS, key_mistakes
from taction.netlist_gen.scene.known_keys import table, text
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import Complaint, InputError
from tests.support.paths import SCENES
from tests.support.running import python

BAD: tuple[Any, ...] = (
    "", "10pf", "10 p F", "1,5", "m", "-3", "12%", "nan", "auto", "1" * 200, "ideal",
    -1, 0, 2, 7.5, 200, 1e-200, 1e200, 10**30, math.inf, math.nan, True, False,
    [], {}, {"kind": "x"}, {"max": 1, "min": "2s"},
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


def by_the_models(data: dict[str, Any]) -> list[Complaint]:
    try:
        parse_scene(data, "x.toml")
    except InputError as error:
        return list(error.complaints)
    return []


def paths(
    entry: dict[str, Any], data: Any, path: tuple[str, ...] = ()
) -> Iterator[tuple[str, ...]]:
    """Yield every key that a scene of these kinds may have."""
    if entry["form"] == "kinds":
        kind = data.get("kind", entry["default"]) if isinstance(data, dict) else entry["default"]
        entry = entry["of"][kind]
    for key, each in entry.get("keys", {}).items():
        yield (*path, key)
        yield from paths(each, data.get(key, {}) if isinstance(data, dict) else {}, (*path, key))


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


def test_the_table_is_that_of_the_models() -> None:
    assert KEYS.read_text("utf-8") == text(), "run scripts/write_schemas.py"


@pytest.mark.parametrize("data", [WHOLE, CSV, MATRIX], ids=["all tables", "csv load", "matrix"])
def test_every_key_with_bad_values(data: dict[str, Any]) -> None:
    draw = random.Random(7)  # noqa: S311
    assert [*by_the_models(data), *key_mistakes(data)] == []
    early = 0
    for path in paths(table(Scene), data):
        for value in draw.sample(BAD, 7):
            wrong = changed(data, path, value)
            found, expected = key_mistakes(wrong), by_the_models(wrong)
            assert found in ([], expected), (path, value)
            early += bool(found)
            if expected and path[-1] not in ("matrix", "strain", "stress", "error"):
                assert found or isinstance(value, list | dict), (path, value, expected)
    assert early > 200


def test_several_mistakes_at_once() -> None:
    draw = random.Random(25)  # noqa: S311
    every = list(paths(table(Scene), WHOLE))
    several = 0
    for _ in range(300):
        wrong = WHOLE
        for _ in range(draw.randint(2, 5)):
            path = draw.choice(every)
            if draw.random() < 0.3:
                path = (*path[:-1], path[-1] + "x")
            wrong = changed(wrong, path, draw.choice(BAD))
        found, expected = key_mistakes(wrong), by_the_models(wrong)
        assert found in ([], expected), wrong
        several += len(found) > 1
    assert several > 100


@pytest.mark.parametrize("scene", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_no_scene_is_refused(scene: Any) -> None:
    assert key_mistakes(tomllib.loads(scene.read_text("utf-8"))) == []


def test_a_refused_file_loads_no_models(tmp_path: Any) -> None:
    board = (SCENES / "paper-breadboard.toml").read_text("utf-8")
    for name, old, new in (("key", "capacitance =", "capacitence ="), ("quote", '"10pF"', '"10pF')):
        file = tmp_path / f"{name}.toml"
        file.write_text(board.replace(old, new, 1), "utf-8")
        code = (
            "import sys; from taction.cli.main import main\n"
            f"try: main(['verify', {str(file)!r}])\n"
            "except SystemExit as end: assert end.code == 2, end\n"
            "heavy = {'numpy', 'pydantic', 'rich'} & set(sys.modules)\n"
            "sys.exit(repr(heavy) if heavy else 0)"
        )
        done = python("-c", code)
        assert done.returncode == 0, done.stderr
        with pytest.raises(InputError):
            load_scene(file)


def test_the_table_is_small() -> None:
    assert len(json.dumps(json.loads(KEYS.read_text("utf-8")))) < 20_000
