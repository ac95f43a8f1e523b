"""Keys of a scene by name, with type and unit as the scene's own fields declare them."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_args

from pydantic import BaseModel

from netlist_gen.board.scalings import choose_opamp, make_scalings
from netlist_gen.quantities import parse
from netlist_gen.scene.fields import Unit
from netlist_gen.scene.scene import Scene
from spice_models.errors import Complaint, InputError
from spice_models.opamp import phase_margin

SYMBOLS = {
    "C": "design.capacitance",
    "R": "design.resistance",
    "s": "design.gain",
    "G0": "design.unit_conductance",
    "U0": "design.unit_voltage",
    "Ve": "design.exponential_slope",
}
# Where a bare name is looked for, in this order.
SECTIONS = ("", "design", "design.opamp", "problem", "problem.load", "problem.noise", "analysis")

Value = float | int | str | bool


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a scene.

    Attributes
    ----------
    path : str
        Dotted, as the scene file has it.
    kind : str
        ``"real"``, ``"integer"``, or ``"choice"`` for words and truth values.
    unit : str
        SI unit; empty for a plain number.
    """

    path: str
    kind: Literal["real", "integer", "choice"]
    unit: str


def find_key(scene: Scene, name: str) -> Key:
    """Return the key that `name` means in `scene`.

    Raises
    ------
    InputError
        There is none; the nearest one is named.
    """
    found = _search(scene, name)
    if found is not None:
        return found
    known = {symbol: symbol for symbol in SYMBOLS}
    for key in all_keys(scene):
        known[key.path] = key.path
        last = key.path.rpartition(".")[2]
        known.setdefault(last, last if _search(scene, last) else key.path)
    folded = {word.lower(): full for word, full in reversed(known.items())}
    close = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=0.5)
    hint = f"did you mean {folded[close[0]]!r}? " if close else ""
    text = (
        f"no key of this scene; {hint}known: {', '.join(SYMBOLS)}, or a key such as 'design.gain'"
    )
    raise InputError("--over", Complaint("key", repr(name), text))


def _search(scene: Scene, name: str) -> Key | None:
    path = SYMBOLS.get(name, name)
    places = (_look_up(scene, f"{part}.{path}" if part else path) for part in SECTIONS)
    return next((key for key in places if key is not None), None)


def all_keys(scene: Scene) -> Iterator[Key]:
    """Every key that a study can change."""
    yield from _keys(scene, "")


def _keys(model: BaseModel, prefix: str) -> Iterator[Key]:
    for name, field in type(model).model_fields.items():
        path = f"{prefix}{field.alias or name}"
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _keys(value, f"{path}.")
        else:
            yield _key(path, field.annotation, field.metadata)


def _look_up(scene: Scene, path: str) -> Key | None:
    model: object = scene
    *sections, last = path.split(".")
    for part in sections:
        model = _child(model, part)
    for name, field in _fields(model):
        if last in (name, field.alias) and not isinstance(getattr(model, name), BaseModel):
            canonical = ".".join([*sections, field.alias or name])
            return _key(canonical, field.annotation, field.metadata)
    return None


def _child(model: object, part: str) -> object:
    names = [name for name, field in _fields(model) if part in (name, field.alias)]
    return getattr(model, names[0]) if names else None


def _fields(model: object) -> list[tuple[str, Any]]:
    return list(type(model).model_fields.items()) if isinstance(model, BaseModel) else []


def _key(path: str, annotation: Any, metadata: list[Any]) -> Key:
    parts = [*_parts(annotation), *metadata]
    units = [part.unit for part in parts if isinstance(part, Unit)]
    if float in parts:
        return Key(path, "real", units[0] if units else "")
    return Key(path, "integer" if int in parts else "choice", "")


def _parts(annotation: Any) -> Iterator[Any]:
    """Types and metadata of an annotation, through unions and Annotated."""
    yield annotation
    for part in get_args(annotation):
        yield from _parts(part)
    yield from getattr(annotation, "__metadata__", ())


def read_value(key: Key, text: str) -> Value:
    """Return what was written for `key`, in base units.

    Raises
    ------
    InputError
        It is no value of this kind.
    """
    try:
        if key.kind == "choice":
            return {"true": True, "false": False}.get(text, text)
        if key.unit:
            return parse(text, key.unit)
        number = int(text) if key.kind == "integer" else float(text)
    except ValueError as error:
        plain = f"expected {'a whole' if key.kind == 'integer' else 'a plain'} number"
        accepted = str(error) if key.unit else plain
        raise InputError("--over", Complaint(key.path, repr(text), accepted)) from None
    if not math.isfinite(number):
        raise InputError("--over", Complaint(key.path, repr(text), "expected a finite number"))
    return number


_DERIVED: dict[str, Callable[[Scene], float]] = {
    "design.resistance": lambda scene: make_scalings(scene).resistance,
    "design.lambda": lambda scene: make_scalings(scene).lam,
    "design.exponential_slope": lambda scene: make_scalings(scene).exponential_slope,
    "design.opamp.phase_margin": lambda scene: phase_margin(choose_opamp(scene)),
}


def own_value(scene: Scene, key: Key) -> float | None:
    """Return the number that `key` has in `scene`, given or derived; None where it has none."""
    if key.path in _DERIVED:
        return _DERIVED[key.path](scene)
    *sections, last = key.path.split(".")
    if sections == ["design", "opamp"] and key.kind == "real":
        return float(getattr(choose_opamp(scene), last))
    model: object = scene
    for part in key.path.split("."):
        model = _child(model, part)
    return float(model) if isinstance(model, int | float) else None
