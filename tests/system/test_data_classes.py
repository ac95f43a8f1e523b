"""The own `dataclass` beside that of the standard library, on classes of the same text."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

from taction.system import data_classes

TEXT = """
from __future__ import annotations
from dataclasses import field
from typing import ClassVar

@dataclass(frozen=True, slots=True)
class Point:
    x: float
    y: float = 0.0
    names: tuple[str, ...] = field(default_factory=tuple)
    KIND: ClassVar[str] = "point"

@dataclass(frozen=True, slots=True)
class Named(Point):
    given: str = field(default="", kw_only=True)
    hidden: list[int] = field(default_factory=list, repr=False, compare=False)

@dataclass(frozen=True)
class Cached:
    value: int
    twice: int = field(init=False)
    fixed: int = field(default=7, init=False)
    def __post_init__(self):
        object.__setattr__(self, "twice", 2 * self.value)

@dataclass(frozen=True, slots=True, eq=False)
class Identity:
    value: int

@dataclass(slots=True)
class Changing:
    value: int
    _store: int = 3

@dataclass(slots=True, kw_only=True, repr=False)
class Keywords:
    first: int = 1
    second: int

@dataclass(frozen=True, slots=True)
class One:
    value: float
    def __repr__(self):
        return "its own"

@dataclass(frozen=True)
class Nothing:
    pass
"""
MADE: dict[str, Callable[[Any], Any]] = {
    "a point": lambda m: m.Point(1.0),
    "all arguments": lambda m: m.Point(1.0, 2.0, ("a",)),
    "a subclass": lambda m: m.Named(1.0, 2.0, given="b"),
    "a hidden value": lambda m: m.Named(1.0, 2.0, given="b", hidden=[1]),
    "after init": lambda m: m.Cached(4),
    "compared by identity": lambda m: m.Identity(5),
    "not frozen": lambda m: m.Changing(5, 6),
    "keywords": lambda m: m.Keywords(second=2),
    "one field": lambda m: m.One(float("inf")),
    "no field": lambda m: m.Nothing(),
    "an argument too many": lambda m: m.Nothing(1),
    "an argument too few": lambda m: m.Point(),
    "a keyword by its place": lambda m: m.Keywords(1, 2),
    "no argument at all": lambda m: m.Cached(4, 5),
}


def module(monkeypatch: pytest.MonkeyPatch, dataclass: object) -> ModuleType:
    """Make the classes of `TEXT`; pickle finds them by the module's name."""
    made = ModuleType("classes_of_a_test")
    vars(made)["dataclass"] = dataclass
    monkeypatch.setitem(sys.modules, made.__name__, made)
    exec(TEXT, vars(made))  # noqa: S102
    return made


def outcome(job: Callable[[], object]) -> object:
    """What a job returns, or the kind and the text of its error."""
    try:
        return job()
    except (TypeError, AttributeError) as error:
        return type(error), str(error)


def changed(value: Any) -> object:
    """The first field after it was set, and after it was deleted."""
    name = dataclasses.fields(value)[0].name if dataclasses.fields(value) else "any"

    def put() -> object:
        setattr(value, name, 9)
        return getattr(value, name)

    return outcome(put), outcome(lambda: delattr(value, name))


def behaviour(made: ModuleType, make: Callable[[Any], Any]) -> list[object]:
    """All that a value does, as texts and numbers that two modules have in common."""
    value = outcome(lambda: make(made))
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return [value]
    same, plain = make(made), dataclasses.asdict
    hashed = outcome(lambda: hash(value) == hash(same))
    texts = [repr(value)] if type(value).__repr__ is not object.__repr__ else []
    first = {field.name: 9 for field in dataclasses.fields(value)[:1]}
    again = [pickle.loads(pickle.dumps(value)), copy.copy(value), copy.deepcopy(value)]  # noqa: S301
    return [
        *texts,
        value == same,
        value != same,
        value == 3,
        hashed,
        plain(value),
        *(plain(each) for each in again),
        *(each == value for each in again),
        outcome(lambda: plain(dataclasses.replace(value, **first))),
        hasattr(value, "__dict__"),
        type(value).__match_args__,
        str(inspect.signature(type(value))),
        changed(same),
    ]


@pytest.mark.parametrize("name", MADE)
def test_a_class_behaves_as_that_of_the_standard_library(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = behaviour(module(monkeypatch, data_classes.dataclass), MADE[name])
    assert ours == behaviour(module(monkeypatch, dataclasses.dataclass), MADE[name])


def test_two_values_differ_where_a_compared_field_does(monkeypatch: pytest.MonkeyPatch) -> None:
    made = module(monkeypatch, data_classes.dataclass)
    assert made.Point(1.0) != made.Point(2.0)
    assert made.Point(1.0) != made.Named(1.0)
    assert made.Named(1.0, hidden=[1]) == made.Named(1.0, hidden=[2])
    assert len({made.Point(1.0), made.Point(1.0), made.Point(1.0, 3.0)}) == 2
    assert made.Identity(1) != made.Identity(1)
