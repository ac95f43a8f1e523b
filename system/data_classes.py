"""`dataclass` of the standard library, at a third of its time.

The standard decorator compiles up to seven methods of each class from text. A verdict loads some
250 classes, and that was 14 % of a `verify` by the state-space engine. Here only ``__init__`` is
compiled; the other methods are functions that read the fields.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any

Method = Callable[..., Any]


class _Unset:
    """Default of an argument whose value a factory makes."""

    def __repr__(self) -> str:
        return "<factory>"


UNSET = _Unset()

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(
        cls: type | None = None,
        /,
        *,
        frozen: bool = False,
        slots: bool = False,
        eq: bool = True,
        repr: bool = True,
        kw_only: bool = False,
    ) -> Any:
        """Return the class with the methods of `dataclasses.dataclass`.

        Only its parameters that taction uses are known; an own method of the class stays.

        Examples
        --------
        >>> @dataclass(frozen=True, slots=True)
        ... class Pole:
        ...     real: float
        ...     imaginary: float = 0.0
        >>> Pole(-1.0), Pole(-1.0) == Pole(-1.0, 0.0)
        (Pole(real=-1.0, imaginary=0.0), True)
        """

        def decorated(cls: type) -> type:
            own = {*vars(cls)}
            cls = _fields_only(slots=slots, kw_only=kw_only)(cls)
            for name, method in _methods(cls, frozen, slots, eq, repr):
                if name not in own:
                    setattr(cls, name, method)
            return cls

        return decorated if cls is None else decorated(cls)


def _fields_only(*, slots: bool, kw_only: bool) -> Method:
    return dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots, kw_only=kw_only)


def _methods(
    cls: type[Any], frozen: bool, slots: bool, eq: bool, repr: bool
) -> list[tuple[str, Method | None]]:
    fields = dataclasses.fields(cls)
    methods: list[tuple[str, Method | None]] = [("__init__", _init(cls, fields, frozen))]
    if repr:
        methods.append(("__repr__", _repr(tuple(field.name for field in fields if field.repr))))
    if eq:
        values = _values(tuple(field.name for field in fields if field.compare))
        methods += [("__eq__", _eq(values)), ("__hash__", _hash(values) if frozen else None)]
    if frozen:
        methods += FROZEN
    if frozen and slots:
        methods += PICKLED
    return methods


def _init(cls: type[Any], fields: tuple[dataclasses.Field[Any], ...], frozen: bool) -> Method:
    """Return ``__init__``; of a frozen class it stores by ``object.__setattr__``."""
    given: dict[str, Any] = {}
    arguments, named, body = ["self"], list[str](), list[str]()
    for field in fields:
        name = value = field.name
        argument = name
        if field.default_factory is not dataclasses.MISSING:
            given[name], argument = field.default_factory, f"{name}=_unset"
            value = f"_given['{name}']()"
            if field.init:
                value += f" if {name} is _unset else {name}"
        elif field.default is not dataclasses.MISSING:
            given[name], argument = field.default, f"{name}=_given['{name}']"
        elif not field.init:
            continue
        if field.init:
            (named if field.kw_only else arguments).append(argument)
        elif field.default_factory is dataclasses.MISSING:
            value = f"_given['{name}']"
        body.append(f"_store(self, '{name}', {value})" if frozen else f"self.{name} = {value}")
    if named:
        arguments += ["*", *named]
    if hasattr(cls, "__post_init__"):
        body.append("self.__post_init__()")
    text = f"def __init__({', '.join(arguments)}):\n " + "\n ".join(body or ["pass"])
    names: dict[str, Any] = {"_given": given, "_store": object.__setattr__, "_unset": UNSET}
    exec(text, names)  # noqa: S102 - of names of fields
    init: Method = names["__init__"]
    init.__qualname__ = f"{cls.__qualname__}.__init__"
    init.__annotations__ = {field.name: field.type for field in fields if field.init}
    init.__annotations__["return"] = None
    return init


def _values(names: tuple[str, ...]) -> Method:
    if len(names) > 1:
        return attrgetter(*names)
    return lambda self: tuple(getattr(self, name) for name in names)


def _repr(names: tuple[str, ...]) -> Method:
    def shown(self: Any) -> str:
        values = (f"{name}={getattr(self, name)!r}" for name in names)
        return f"{type(self).__qualname__}({', '.join(values)})"

    return shown


def _eq(values: Method) -> Method:
    def equal(self: Any, other: Any) -> Any:
        return (
            values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented
        )

    return equal


def _hash(values: Method) -> Method:
    def hashed(self: Any) -> int:
        return hash(values(self))

    return hashed


def _no_setattr(self: Any, name: str, value: object) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")


def _no_delattr(self: Any, name: str) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


def _getstate(self: Any) -> list[Any]:
    return [getattr(self, field.name) for field in dataclasses.fields(self)]


def _setstate(self: Any, state: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)


FROZEN = (("__setattr__", _no_setattr), ("__delattr__", _no_delattr))
PICKLED = (("__getstate__", _getstate), ("__setstate__", _setstate))
