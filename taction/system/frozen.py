"""`frozen`: a frozen dataclass with slots whose import costs a fraction of `dataclass`'s time.

`dataclasses.dataclass` compiles six methods for each class when its module is imported. The 240
classes that a `verify` imports cost it a quarter of its time, and it makes instances of half of
them. A frozen class is a dataclass (`fields`, `replace` and `asdict` work), but all of them share
the methods that need no compiled text, and ``__init__`` is compiled when it is first looked up.

What it does not do: ``order`` and `dataclasses.InitVar`. A class below a frozen one is made by
`frozen`, too, and refuses new attributes even if it is not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError, dataclass, field, fields
from functools import cache, partial
from reprlib import recursive_repr
from typing import Any, TypeVar, dataclass_transform, overload

T = TypeVar("T")


@overload
def frozen(kind: type[T], /) -> type[T]: ...
@overload
def frozen(
    *, eq: bool = True, repr: bool = True, kw_only: bool = False, slots: bool = True
) -> Callable[[type[T]], type[T]]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(
    kind: type[Any] | None = None,
    /,
    *,
    eq: bool = True,
    repr: bool = True,
    kw_only: bool = False,
    slots: bool = True,
) -> Any:
    """Make a class a frozen dataclass with slots.

    Parameters
    ----------
    eq : bool
        Whether two objects with equal fields are equal and have the same hash; else each is only
        equal to itself.
    repr : bool
        Whether ``repr`` shows the fields.
    kw_only : bool
        Whether the fields are passed by name only.
    slots : bool
        False for a class with a ``cached_property``.

    Examples
    --------
    >>> @frozen
    ... class Edge:
    ...     at: float
    ...     stable_below: bool = True
    >>> Edge(8.35e-12)
    Edge(at=8.35e-12, stable_below=True)
    """
    if kind is None:
        return partial(frozen, eq=eq, repr=repr, kw_only=kw_only, slots=slots)
    own = vars(kind)
    made = dataclass(kind, init=False, repr=False, eq=False, kw_only=kw_only, slots=slots)
    shared: dict[str, Any] = {"__setattr__": _refuse, "__delattr__": _keep}
    if "__init__" not in own:
        shared["__init__"] = _Initialiser(made)
    if slots:
        shared |= {"__getstate__": _values, "__setstate__": _restore}
    if repr:
        shared["__repr__"] = _shown
    if eq:
        shared |= {"__eq__": _equal, "__hash__": _hashed}
    for name, method in shared.items():
        if own.get(name) is None:  # a class with an `__eq__` of its own has a hash of None
            setattr(made, name, method)
    return made


class _Initialiser:
    """The ``__init__`` of a frozen class until someone looks it up."""

    def __init__(self, kind: type) -> None:
        self.kind = kind

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        method = self.kind.__init__ = _initialiser(self.kind)  # type: ignore[misc]
        return method.__get__(instance, owner)


def _initialiser(kind: type) -> Any:
    """Compile ``__init__`` of a class from its fields, as `dataclasses` does."""
    names: dict[str, Any] = {"_put": object.__setattr__, "_MISSING": MISSING}
    every: tuple[Field[Any], ...] = fields(kind)
    taken = [each for each in every if each.init]
    words = [_parameter(each, names) for each in taken if not each.kw_only]
    if len(words) < len(taken):
        words += ["*", *(_parameter(each, names) for each in taken if each.kw_only)]
    lines = [
        f" _put(_self, {each.name!r}, {_argument(each, names)})"
        for each in every
        if each.init or not each.default is each.default_factory is MISSING
    ]
    if hasattr(kind, "__post_init__"):
        lines.append(" _self.__post_init__()")
    text = f"def __init__({', '.join(['_self', *words])}):\n" + "\n".join(lines or [" pass"])
    exec(text, names)  # noqa: S102 - of names of fields only
    method = names["__init__"]
    method.__qualname__ = f"{kind.__qualname__}.__init__"
    method.__module__ = kind.__module__
    method.__annotations__ = {**{each.name: each.type for each in taken}, "return": None}
    return method


def _parameter(each: Field[Any], names: dict[str, Any]) -> str:
    """Return the text of a parameter; its default becomes one of `names`."""
    if each.default_factory is not MISSING:
        return f"{each.name}=_MISSING"
    if each.default is MISSING:
        return each.name
    names[f"_default_{each.name}"] = each.default
    return f"{each.name}=_default_{each.name}"


def _argument(each: Field[Any], names: dict[str, Any]) -> str:
    """Return the text of a field's value; its factory becomes one of `names`."""
    if each.default_factory is MISSING:
        if not each.init:
            names[f"_default_{each.name}"] = each.default
        return each.name if each.init else f"_default_{each.name}"
    make = f"_make_{each.name}"
    names[make] = each.default_factory
    return f"{make}() if {each.name} is _MISSING else {each.name}" if each.init else f"{make}()"


def _refuse(self: object, name: str, value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _keep(self: object, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


@cache
def _compared(kind: type) -> tuple[str, ...]:
    """Return the names of the fields that count for ``==``."""
    return tuple(each.name for each in fields(kind) if each.compare)


@cache
def _counted(kind: type) -> tuple[str, ...]:
    """Return the names of the fields that count for ``hash``."""
    every = fields(kind)
    return tuple(each.name for each in every if (each.compare if each.hash is None else each.hash))


def _equal(self: Any, other: Any) -> Any:
    if type(other) is not type(self):
        return NotImplemented
    names = _compared(self.__class__)
    return tuple([getattr(self, n) for n in names]) == tuple([getattr(other, n) for n in names])


def _hashed(self: Any) -> int:
    return hash(tuple([getattr(self, name) for name in _counted(self.__class__)]))


@recursive_repr()
def _shown(self: Any) -> str:
    shown = (f"{each.name}={getattr(self, each.name)!r}" for each in fields(self) if each.repr)
    return f"{type(self).__qualname__}({', '.join(shown)})"


def _values(self: Any) -> list[Any]:
    return [getattr(self, each.name) for each in fields(self)]


def _restore(self: Any, state: list[Any]) -> None:
    for each, value in zip(fields(self), state, strict=True):
        object.__setattr__(self, each.name, value)
