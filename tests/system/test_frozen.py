"""`frozen` beside `dataclasses.dataclass`: the same classes made by both."""

import copy
import dataclasses
import inspect
import pickle
import threading
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import pytest

from taction.system.frozen import frozen

T = TypeVar("T")
made: dict[str, list[type]] = {"by_dataclass": [], "by_frozen": []}


def both(**options: Any) -> Callable[[type], type]:
    """Make a class by `dataclass` and by `frozen`; the second one keeps the name."""

    def decorate(kind: type) -> type:
        twin = type(kind.__name__, kind.__bases__, dict(vars(kind)))
        made["by_dataclass"].append(dataclass(twin, frozen=True, **{"slots": True, **options}))
        made["by_frozen"].append(frozen(**options)(kind))
        return made["by_frozen"][-1]

    return decorate


@both()
class Plain:
    """Defaults, a factory, and a field that is not shown and not compared."""

    a: float
    b: str = "b"
    c: list[float] = field(default_factory=list, compare=False)
    d: int = field(default=4, repr=False, compare=False)


@both(kw_only=True)
class ByName:
    """Fields by name."""

    a: float
    b: int = 2


@both()
class Mixed:
    """One field by name, and two that are no parameters."""

    b: float = field(kw_only=True)
    a: float
    c: int = field(default=3, init=False)
    d: dict[str, int] = field(default_factory=dict, init=False, compare=False)


@both()
class Hashed:
    """A list that counts for equality alone."""

    a: float
    b: list[float] = field(default_factory=list, hash=False)


@both()
class Empty:
    """No field."""


PAIRS = list(zip(made["by_dataclass"], made["by_frozen"], strict=True))
CALLS: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((), {}),
    ((1.0,), {}),
    ((1.0, "x"), {}),
    ((1.0, "x", [2.0], 5), {}),
    ((), {"a": 1.0}),
    ((1.0,), {"b": 2.5}),
    ((1.0,), {"c": [3.0]}),
    ((1.0,), {"wrong": 1}),
    ((1.0, 2, 3, 4, 5), {}),
]


def outcome(kind: type, words: tuple[Any, ...], named: dict[str, Any]) -> object:
    try:
        value: Any = kind(*words, **named)
    except TypeError as error:
        return str(error)
    return repr(value), asdict(value), hash(value), dataclasses.astuple(value)


@pytest.mark.parametrize("call", CALLS, ids=str)
@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair[0].__name__)
def test_a_call_does_what_a_dataclass_does(pair: tuple[type, type], call: Any) -> None:
    assert outcome(pair[1], *call) == outcome(pair[0], *call)


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair[0].__name__)
def test_signature_fields_and_patterns_are_those_of_a_dataclass(pair: tuple[Any, Any]) -> None:
    by_dataclass, by_frozen = pair
    ours, theirs = (inspect.signature(kind).parameters.values() for kind in pair)
    assert [(p.name, p.kind) for p in ours] == [(p.name, p.kind) for p in theirs]
    assert [p.default is p.empty for p in ours] == [p.default is p.empty for p in theirs]
    assert [f.name for f in fields(by_frozen)] == [f.name for f in fields(by_dataclass)]
    assert by_frozen.__match_args__ == by_dataclass.__match_args__
    assert by_frozen.__slots__ == by_dataclass.__slots__
    assert by_frozen.__doc__ == by_dataclass.__doc__


def test_init_is_compiled_when_it_is_first_looked_up() -> None:
    @frozen
    class Once:
        a: int

    assert not inspect.isfunction(vars(Once)["__init__"])
    assert Once(1).a == 1
    assert inspect.isfunction(vars(Once)["__init__"])
    assert Once.__init__.__qualname__ == f"{Once.__qualname__}.__init__"


def test_fields_are_neither_set_nor_deleted() -> None:
    value = Plain(1.0)
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'a'"):
        value.a = 2.0
    with pytest.raises(FrozenInstanceError, match="cannot delete field 'a'"):
        del value.a
    with pytest.raises(FrozenInstanceError):
        value.other = 2.0
    assert value.a == 1.0


def test_equality_hash_and_replace() -> None:
    assert Plain(1.0, c=[1.0]) == Plain(1.0, c=[2.0])
    assert Plain(1.0) != Plain(2.0)
    assert Plain(1.0) != ByName(a=1.0)
    assert len({Plain(1.0), Plain(1.0), Plain(2.0)}) == 2
    assert replace(Plain(1.0), b="x") == Plain(1.0, "x")
    with pytest.raises(TypeError, match="wrong"):
        replace(Plain(1.0), wrong=1)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_a_value_is_pickled(protocol: int) -> None:
    value = Plain(1.0, "x", [2.0], 7)
    pickled = pickle.loads(pickle.dumps(value, protocol))  # noqa: S301
    for same in (pickled, copy.deepcopy(value)):
        assert dataclasses.astuple(same) == dataclasses.astuple(value)


@frozen(slots=False)
class Lazy:
    """With a cached property."""

    a: int

    @cached_property
    def double(self) -> int:
        return 2 * self.a


def test_a_cached_property_is_kept_and_pickled() -> None:
    value = Lazy(2)
    assert value.double == 4
    assert vars(value) == {"a": 2, "double": 4}
    same = pickle.loads(pickle.dumps(value))  # noqa: S301
    assert vars(same) == {"a": 2, "double": 4}
    assert replace(value, a=3).double == 6


@frozen(eq=False)
class Base(Generic[T]):
    """Generic, only equal to itself, checks itself."""

    a: T

    def __post_init__(self) -> None:
        if self.a is None:
            raise ValueError("a is missing")


@frozen
class Below(Base[int]):
    """Adds a field; has an equality and a hash."""

    b: int = 1

    def __repr__(self) -> str:
        return "own"


def test_inheritance_generics_and_checks() -> None:
    assert Base(1) != Base(1)
    assert hash(one := Base(1)) == object.__hash__(one)
    assert Below(1, 2) == Below(1, 2) != Below(1)
    assert repr(Below(1)) == "own"
    assert repr(Base(1)) == "Base(a=1)"
    assert not hasattr(Below(1), "__dict__")
    with pytest.raises(ValueError, match="a is missing"):
        Base(None)
    with pytest.raises(ValueError, match="a is missing"):
        replace(Below(1), a=None)
    match Below(1, 2):
        case Below(a, b):
            assert (a, b) == (1, 2)


def test_methods_of_its_own_stay() -> None:
    @frozen
    class Own:
        a: float

        def __eq__(self, other: object) -> bool:
            return True

        def __hash__(self) -> int:
            return 7

    @frozen(repr=False)
    class Made:
        a: float

        def __init__(self) -> None:
            object.__setattr__(self, "a", 3.0)

    assert Own(1.0) == Own(2.0)
    assert hash(Own(1.0)) == 7
    assert Made().a == 3.0
    assert repr(Made()).startswith("<")


def test_threads_may_make_the_first_object_together() -> None:
    @frozen
    class Shared:
        a: int

    found, gate = list[int](), threading.Barrier(8)

    def make(k: int) -> None:
        gate.wait()
        found.append(Shared(k).a)

    threads = [threading.Thread(target=make, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == list(range(8))
