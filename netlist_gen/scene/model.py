"""`Model`: a table of a scene as a class, whose fields state once what each key accepts.

From the annotations follow the check of what a user wrote, with all mistakes at once, the value
with its defaults, its plain data, the JSON Schema, and the names and units that studies read. A
field is annotated with a type, with one of `field_values`, or with another `Model`; `field` adds
the name in a scene, a default or a description::

    class NoiseCheck(Model):
        max: Volts = field(description="largest noise of an output, rms, V")
        lowest: Hertz | None = None
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Protocol,
    Self,
    Union,
    get_args,
    get_origin,
)

from taction.netlist_gen.scene.field_values import Number, ShortText, Truth, Words
from taction.system.errors import Complaint, listed, nearest_question

REQUIRED: Any = object()
PERCENTAGE = re.compile(r"\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*%\s*")
Schema = dict[str, Any]


class MistakesError(ValueError):
    """The data of a table cannot be used; `complaints` lists all mistakes."""

    def __init__(self, name: str, complaints: Collection[Complaint]) -> None:
        self.complaints = tuple(complaints)
        super().__init__("\n".join([f"{name}:", *map(str, self.complaints)]))


@dataclass(frozen=True, slots=True)
class ModelField:
    """A key of a table: its name in a scene, its default, and what it accepts."""

    alias: str = ""
    default: Any = REQUIRED
    description: str = ""
    annotation: Any = None
    form: Form = None  # type: ignore[assignment]  # `Model` sets it

    @property
    def required(self) -> bool:
        """Whether a scene must give the key."""
        return self.default is REQUIRED

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the JSON Schema of the key."""
        made = dict(self.form.schema(shared))
        if "$ref" not in made and {"$ref"} not in map(set, made.get("anyOf", ())):
            made["title"] = self.alias.replace("_", " ").title()
        if self.description:
            made["description"] = self.description
        if not self.required:
            default = self.default
            made["default"] = (
                default.model_dump(by_alias=True) if isinstance(default, Model) else default
            )
        return made


def field(default: Any = REQUIRED, *, alias: str = "", description: str = "") -> Any:
    """State the default of a key, its name in a scene, or what it is.

    Without a default a scene must give the key, and the description tells what it is.
    """
    return ModelField(alias, default, description)


class Model:
    """A table of the scene: frozen, without unknown keys.

    Attributes
    ----------
    PLAIN, PLAIN_TYPES : str, tuple of types
        The key that a plain value in the place of the table stands for, and its types.
    model_fields : mapping of str to ModelField
        The keys by their names in Python.

    Raises
    ------
    MistakesError
        When it is made: `complaints` lists all mistakes.

    Examples
    --------
    >>> class Noise(Model):
    ...     variance: Annotated[float, Number(ge=0)] = 0.0
    >>> Noise(variance=1).variance, Noise().model_dump(), Noise().model_copy({"variance": 2.0})
    (1.0, {'variance': 0.0}, Noise(variance=2.0))
    """

    PLAIN: ClassVar[str] = ""
    PLAIN_TYPES: ClassVar[tuple[type, ...]] = (str,)
    model_fields: ClassVar[dict[str, ModelField]] = {}

    def __init_subclass__(cls) -> None:
        """Read the fields; a default is an attribute of the class, what is given of the table."""
        cls.model_fields = {**cls.model_fields}
        for name, hint in inspect.get_annotations(cls, eval_str=True).items():
            if name.startswith("_") or str(hint).startswith("typing.ClassVar"):
                continue
            given = cls.__dict__.get(name, REQUIRED)
            stated = given if isinstance(given, ModelField) else ModelField(default=given)
            alias = stated.alias or name
            made = replace(stated, alias=alias, annotation=hint, form=_form(hint))
            cls.model_fields[name] = made
            if not made.required:
                setattr(cls, name, made.default)
            elif name in cls.__dict__:
                delattr(cls, name)

    def __init__(self, **values: Any) -> None:
        self.__dict__.update(self.model_validate(values).__dict__)

    @classmethod
    def model_validate(cls, data: Any) -> Self:
        """Return the table of `data`, by the names of a scene.

        Raises
        ------
        MistakesError
            `complaints` lists all mistakes.
        """
        found: list[Complaint] = []
        made = cls.taken(data, "", found)
        found += cls.contradictions(data if isinstance(data, Mapping) else {})
        if found or made is None:
            raise MistakesError(cls.__name__, found)
        return made

    @classmethod
    def taken(cls, data: Any, path: str, found: list[Complaint]) -> Self | None:
        """Return the table of `data` at `path`; None if there are mistakes, added to `found`."""
        if isinstance(data, cls):
            return data
        given, inside = data, f"{path}." if path else ""
        if plain := bool(cls.PLAIN) and isinstance(data, cls.PLAIN_TYPES):
            given = {cls.PLAIN: data}
        if not isinstance(given, Mapping):
            found.append(wrong(path or "scene", data, "expected a table"))
            return None
        before, values = len(found), dict[str, Any]()
        for name, each in cls.model_fields.items():
            here = path if plain else inside + each.alias
            if each.alias in given:
                cls._take(name, given[each.alias], here, values, found)
            elif each.required:
                found.append(Complaint(here, "", f"required; {each.description}"))
        known = [each.alias for each in cls.model_fields.values()]
        for key in (key for key in given if key not in known):
            text = f"unknown key; {nearest_question(str(key), known)}known here: {listed(known)}"
            found.append(Complaint(f"{inside}{key}", value_text(given[key]), text))
        if len(found) > before:
            return None
        made = cls.__new__(cls)
        made.__dict__.update(values)
        if reason := made.contradiction():
            found.append(wrong(path or "scene", data, reason))
        return made

    @classmethod
    def _take(
        cls, name: str, value: Any, path: str, values: dict[str, Any], found: list[Complaint]
    ) -> None:
        before = len(found)
        taken = cls.model_fields[name].form.take(value, path, found)
        if len(found) == before:
            try:
                values[name] = cls.checked(name, taken, values)
            except ValueError as error:
                found.append(wrong(path, value, str(error)))

    @classmethod
    def checked(cls, name: str, value: Any, before: Mapping[str, Any]) -> Any:
        """Return a right value, or raise ValueError where it contradicts those `before` it."""
        return value

    def contradiction(self) -> str:
        """Return what contradicts itself in a table whose keys are right; empty if nothing."""
        return ""

    @classmethod
    def contradictions(cls, data: Mapping[str, Any]) -> Iterator[Complaint]:
        """Yield what contradicts itself in the data of a table, also if single keys are wrong."""
        yield from ()

    @property
    def model_fields_set(self) -> set[str]:
        """The names in Python of the keys that were given."""
        return self.__dict__.keys() & self.model_fields.keys()

    def model_copy(self, update: Mapping[str, Any] | None = None) -> Self:
        """Return the table with other values, which are not checked, by their names in Python."""
        made = type(self).__new__(type(self))
        made.__dict__.update({**self.__dict__, **(update or {})})
        return made

    def model_dump(
        self,
        *,
        mode: Literal["python", "json"] = "python",
        by_alias: bool = False,
        include: Collection[str] | None = None,
        exclude: Collection[str] = (),
        exclude_unset: bool = False,
        exclude_none: bool = False,
    ) -> dict[str, Any]:
        """Return the values as plain data, tables as dicts.

        Parameters
        ----------
        mode : str, optional
            ``"json"``: arrays as lists.
        by_alias : bool, optional
            By the names of a scene, not those in Python.
        include, exclude : collection of str, optional
            Names in Python of the keys that are kept, and of those that are left out.
        exclude_unset, exclude_none : bool, optional
            Leave out what was not given, what is None; in the tables inside, too.
        """
        inside = {"mode": mode, "by_alias": by_alias, "exclude_unset": exclude_unset,
                  "exclude_none": exclude_none}  # fmt: skip
        found: dict[str, Any] = {}
        for name, value in self:
            if name in exclude or (include is not None and name not in include):
                continue
            if (exclude_unset and name not in self.__dict__) or (exclude_none and value is None):
                continue
            if isinstance(value, Model):
                value = value.model_dump(**inside)  # type: ignore[arg-type]
            elif isinstance(value, dict):
                value = dict(value)
            elif mode == "json" and hasattr(value, "tolist"):
                value = value.tolist()
            found[self.model_fields[name].alias if by_alias else name] = value
        return found

    @classmethod
    def model_json_schema(cls) -> Schema:
        """Return the JSON Schema of the table, by the names of a scene."""
        shared: dict[str, Schema] = {}
        made = cls.table_schema(shared)
        return made | ({"$defs": dict(sorted(shared.items()))} if shared else {})

    @classmethod
    def table_schema(cls, shared: dict[str, Schema]) -> Schema:
        """Return the same; the tables inside are put into `shared`."""
        fields = {each.alias: each for each in cls.model_fields.values()}
        required = [name for name, each in fields.items() if each.required]
        table: Schema = {
            "additionalProperties": False,
            "description": inspect.cleandoc(cls.__doc__ or ""),
            "properties": {name: each.schema(shared) for name, each in fields.items()},
            **({"required": required} if required else {}),
            "title": cls.__name__,
            "type": "object",
        }
        if not cls.PLAIN:
            return table
        form = fields[cls.PLAIN].form
        plain = (form.inner if isinstance(form, Maybe) else form).schema(shared)
        return {"anyOf": [*plain.get("anyOf", [plain]), table]}

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise AttributeError(f"{type(self).__name__} is frozen; `model_copy` makes another one")
        self.__dict__[name] = value

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        """Yield the names in Python with their values."""
        return ((name, getattr(self, name)) for name in self.model_fields)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Model) or type(self) is not type(other):
            return NotImplemented
        private = [{k: v for k, v in vars(each).items() if k.startswith("_")}
                   for each in (self, other)]  # fmt: skip
        return tuple(self) == tuple(other) and private[0] == private[1]

    def __hash__(self) -> int:
        return hash((type(self), *self))

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value!r}" for name, value in self)
        return f"{type(self).__name__}({values})"


class ValueCheck(Protocol):
    """An annotation of `field_values`."""

    def check(self, value: object) -> Any:
        """Return the value as it is kept, or raise ValueError."""

    def schema(self) -> Schema:
        """Return the JSON Schema of the values."""


class Form(Protocol):
    """What a key accepts."""

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return the value as a scene keeps it; mistakes at `path` are added to `found`."""

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the JSON Schema of the values."""


@dataclass(frozen=True, slots=True)
class Single:
    """A value that keeps all `checks`."""

    checks: tuple[ValueCheck, ...]

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return the value as the last check returns it."""
        taken = value
        try:
            for each in self.checks:
                taken = each.check(taken)
        except ValueError as error:
            found.append(wrong(path, value, str(error)))
        return taken

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the schemas of all checks in one."""
        return {key: part for each in self.checks for key, part in each.schema().items()}


@dataclass(frozen=True, slots=True)
class Maybe:
    """A value, or None."""

    inner: Form

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return None, or what the value becomes."""
        return None if value is None else self.inner.take(value, path, found)

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the schema of the value, or of null."""
        made = self.inner.schema(shared)
        either = made["anyOf"] if made.keys() == {"anyOf"} else [made]
        return {"anyOf": [*either, {"type": "null"}]}


@dataclass(frozen=True, slots=True)
class Either:
    """A value that one of `forms` accepts; else the mistakes of all of them count."""

    forms: tuple[Form, ...]

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return what the first form makes of the value that accepts it."""
        mistakes: list[Complaint] = []
        for each in self.forms:
            before = len(mistakes)
            taken = each.take(value, path, mistakes)
            if len(mistakes) == before:
                return taken
        found += mistakes
        return None

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the schemas of all forms."""
        return {"anyOf": [each.schema(shared) for each in self.forms]}


@dataclass(frozen=True, slots=True)
class Each:
    """A table with any keys, each with a value of one form."""

    inner: Form

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return a copy of the table."""
        if not isinstance(value, Mapping):
            found.append(wrong(path, value, "expected a table"))
            return None
        for key in value:
            if not isinstance(key, str):
                found.append(wrong(f"{path}.{key}", key, "expected text in quotes"))
        return {key: self.inner.take(each, f"{path}.{key}", found) for key, each in value.items()}

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the schema of any keys."""
        return {"additionalProperties": self.inner.schema(shared), "type": "object"}


@dataclass(frozen=True, slots=True)
class TableForm:
    """A table of one model."""

    model: type[Model]

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return the table."""
        return self.model.taken(value, path, found)

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return a reference to the schema of the model, which is put into `shared`."""
        name = self.model.__name__
        if name not in shared:
            shared[name] = self.model.table_schema(shared)
        return {"$ref": f"#/$defs/{name}"}


@dataclass(frozen=True, slots=True)
class Kinds:
    """A table whose key `kind` says its model; without it, the one with a default for the key."""

    of: dict[str, type[Model]]

    def take(self, value: Any, path: str, found: list[Complaint]) -> Any:
        """Return the table as the model of its kind."""
        if isinstance(value, tuple(self.of.values())):
            return value
        if not isinstance(value, Mapping):
            found.append(wrong(path, value, "expected a table"))
            return None
        default = next((k for k, each in self.of.items() if hasattr(each, "kind")), None)
        kind = value.get("kind", default)
        if kind is None and "kind" not in value:
            text = f"required; {' or '.join(map(repr, self.of))}"
            found.append(Complaint(f"{path}.kind", "", text))
        elif isinstance(kind, str) and kind in self.of:
            return self.of[kind].taken({"kind": kind, **value}, path, found)
        else:
            text = f"{nearest_question(str(kind), self.of)}one of {listed(self.of)}"
            found.append(Complaint(f"{path}.kind", value_text(str(kind)), text))
        return None

    def schema(self, shared: dict[str, Schema]) -> Schema:
        """Return the schemas of all kinds."""
        of = {kind: TableForm(each).schema(shared) for kind, each in self.of.items()}
        mapping = {kind: made["$ref"] for kind, made in of.items()}
        discriminator = {"mapping": mapping, "propertyName": "kind"}
        return {"discriminator": discriminator, "oneOf": list(of.values())}


def _form(annotation: Any) -> Form:
    """Return what an annotation accepts."""
    parts, origin = get_args(annotation), get_origin(annotation)
    if origin is Annotated:
        checks = tuple(part for part in parts[1:] if hasattr(part, "check"))
        return Single(checks) if checks else _form(parts[0])
    if origin in (Union, types.UnionType):
        some = tuple(part for part in parts if part is not types.NoneType)
        if len(some) == 1:
            form = _form(some[0])
        elif all(isinstance(part, type) and issubclass(part, Model) for part in some):
            form = Kinds({get_args(part.model_fields["kind"].annotation)[0]: part for part in some})
        else:
            form = Either(tuple(map(_form, some)))
        return form if len(some) == len(parts) else Maybe(form)
    if origin is Literal:
        return Single((Words(parts),))
    if origin is dict:
        return Each(_form(parts[1]))
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return TableForm(annotation)
    return Single((PLAIN_KINDS[annotation],))


PLAIN_KINDS: dict[Any, ValueCheck] = {
    float: Number(),
    int: Number(whole=True),
    str: ShortText(),
    bool: Truth(),
}


def wrong(path: str, value: Any, accepted: str) -> Complaint:
    """Return the complaint about a value; of a percentage it says how to write it."""
    if isinstance(value, str) and (found := PERCENTAGE.fullmatch(value)):
        accepted = f"{accepted}; {found[1]} % is {float(found[1]) / 100.0:g}"
    return Complaint(path, value_text(value), accepted)


def value_text(value: object) -> str:
    """Return a value as a complaint has it."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
