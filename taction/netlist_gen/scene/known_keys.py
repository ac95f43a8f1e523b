"""The table of all keys of a scene, as its models declare them: what each key accepts.

`key_mistakes` reads the table from the file beside it, because the models take long to load.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from taction.netlist_gen.scene.checks import UpperLimit
from taction.netlist_gen.scene.design import AntilogChoice, OpAmpChoice
from taction.netlist_gen.scene.field_values import Rule, TemperatureRange, Unit
from taction.netlist_gen.scene.open_tables import NAMES, OneOf
from taction.netlist_gen.scene.problem import CylinderLoad
from taction.netlist_gen.scene.scene import Scene

Entry = dict[str, Any]
PLAIN = {UpperLimit: "max", AntilogChoice: "stage", OpAmpChoice: "base"}
"""The key that a plain value stands for, in the place of the table."""
LIMITS = ("gt", "ge", "lt", "le")


def text() -> str:
    """Return the file ``known_keys.json``."""
    return json.dumps(table(Scene), indent=1) + "\n"


def table(model: type[BaseModel]) -> Entry:
    """Return the entry of a table."""
    keys = {field.alias or name: _entry(field) for name, field in model.model_fields.items()}
    plain = next((key for kind, key in PLAIN.items() if issubclass(model, kind)), None)
    return {"form": "table", **({"plain": plain} if plain else {}), "keys": keys}


def _entry(field: FieldInfo) -> Entry:
    required = {"required": field.description} if field.is_required() else {}
    return _form(field.annotation, field.metadata) | required


def _form(annotation: Any, metadata: list[Any]) -> Entry:
    parts = [*_parts(annotation), *metadata]
    models = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
    if len(models) > 1:
        default = "cylinder" if CylinderLoad in models else None
        of = {get_args(each.model_fields["kind"].annotation)[0]: table(each) for each in models}
        return {"form": "kinds", "default": default, "of": of}
    if models:
        return table(models[0])
    if get_origin(annotation) is dict:
        return {"form": "numbers", "each": _form(get_args(annotation)[1], [])}
    for part in parts:
        if isinstance(part, Unit):
            given = {name: value for name, value in asdict(part).items() if value}
            return {"form": "quantity", "unit": given}
        if isinstance(part, Rule):
            return {"form": "rule", "names": part.names}
        if isinstance(part, TemperatureRange):
            return {"form": "temperatures"}
        if isinstance(part, OneOf):
            return {"form": "name", "of": next(of for of, each in NAMES.items() if each is part)}
    return _plain(parts)


def _plain(parts: list[Any]) -> Entry:
    """Return the entry of a number, a text, a truth value or one of some words."""
    names = [name for part in parts if get_origin(part) is Literal for name in get_args(part)]
    if names and float not in parts:
        truth = {"truth": True} if set(names) == {"typical", "max", "none"} else {}
        return {"form": "choice", "names": names, **truth}
    limits = {
        name: getattr(each, name)
        for part in parts
        for each in getattr(part, "metadata", [part])
        for name in LIMITS
        if getattr(each, name, None) is not None
    }
    if names:
        return {"form": "word or number", "names": names, **limits}
    if not {float, int, str, bool} & {part for part in parts if isinstance(part, type)}:
        return {"form": "else"}
    if float in parts:
        return {"form": "number", **limits}
    if int in parts:
        return {"form": "whole", **limits}
    if bool in parts:
        return {"form": "truth"}
    return {"form": "text", **_lengths(parts)}


def _lengths(parts: list[Any]) -> Entry:
    names = {"least": "min_length", "most": "max_length", "pattern": "pattern"}
    return {
        short: getattr(each, name)
        for part in parts
        for each in getattr(part, "metadata", [part])
        for short, name in names.items()
        if getattr(each, name, None) is not None
    }


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield types and annotations, also inside unions and Annotated."""
    yield annotation
    if get_origin(annotation) is Literal:
        return
    for part in get_args(annotation):
        yield from _parts(part)
    if get_origin(annotation) is Annotated:
        yield from annotation.__metadata__
