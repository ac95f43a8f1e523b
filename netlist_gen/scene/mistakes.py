"""All mistakes in a scene's data at once, also those that no single key shows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from taction.netlist_gen.scene.model import (
    Kinds,
    Maybe,
    MistakesError,
    Model,
    TableForm,
    value_text,
)
from taction.system.errors import Complaint, InputError, listed, nearest_question
from taction.system.quantities import parse, show

Root = TypeVar("Root", bound=Model)


def validated(
    root: type[Root], data: Mapping[str, Any], file: str | Path, *, written: bool = True
) -> Root:
    """Return the `data` of `file` as a `root`; InputError lists all mistakes.

    `written` tells that `data` is what the user wrote, with the units that were given.
    """
    complaints = [*impossible(data)] if written else []
    try:
        model = root.model_validate(data)
    except MistakesError as error:
        raise InputError(file, *error.complaints, *complaints) from None
    if complaints:
        raise InputError(file, *complaints)
    return model


def placed(root: type[Model], data: dict[str, Any], values: Mapping[str, Any]) -> list[Complaint]:
    """Put `values` into the tables of `data`; return the complaints about unknown names.

    A name is a key or a table at any depth (``capacitance``, ``settling_time``), or a dotted path.
    """
    paths: dict[str, list[str]] = {}
    for name, path in _all_keys(root, data):
        for spelling in {name, path.rpartition(".")[2], path}:
            paths.setdefault(spelling, []).append(path)
    complaints = []
    for name, value in values.items():
        matches = paths.get(name, [])
        if len(matches) != 1:
            several = f"several keys have this name; one of {listed(matches)}"
            text = several if matches else f"unknown key; {nearest_question(name, list(paths))}"
            complaints.append(Complaint(name, value_text(value), text.rstrip()))
            continue
        *tables, last = matches[0].split(".")
        table = data
        for key in tables:
            table = table.setdefault(key, {})
        table[last] = value
    return complaints


def _all_keys(model: type[Model], data: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the name in Python and the path of every key and table below `model`."""
    for name, field in model.model_fields.items():
        key = field.alias
        yield name, prefix + key
        inside = data.get(key) if isinstance(data, Mapping) else None
        kind = inside.get("kind") if isinstance(inside, Mapping) else None
        if (table := _table_of(field.form, kind)) is not None:
            yield from _all_keys(table, inside, f"{prefix}{key}.")


def _table_of(form: object, kind: object) -> type[Model] | None:
    """Return the model of a form, of several that of `kind`; None without a model."""
    if isinstance(form, Maybe):
        form = form.inner
    if isinstance(form, Kinds):
        return form.of.get(str(kind), next(iter(form.of.values())))
    return form.model if isinstance(form, TableForm) else None


IMPOSSIBLE = (  # key, unit, type, least and largest value; no board has others of this type
    ("capacitance", "F", (int, float), 0.0, 1.0, "'10pF' is 10 picofarad; a number is in F"),
    ("gain", "ohm", str, 1.0, math.inf, "'m' is milli, 'M' is mega: '6.25Mohm'"),
)
"""A capacitance of 10 without a unit is a slip, ``"10F"`` may be meant; so may a gain of 1e-3, but
not one with the prefix m. What may be meant is asked about (`questions`)."""


def impossible(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Yield the values of a design that are a slip beyond doubt."""
    design = _table(data.get("design"))
    for key, unit, kind, least, most, instead in IMPOSSIBLE:
        if not isinstance(design.get(key), kind):
            continue
        try:
            value = parse(design[key], unit)
        except (TypeError, ValueError):
            continue  # the key's own check has it
        if 0.0 < value < least or value > most:
            text = f"{show(value, unit)} is what no board has; is the prefix right? {instead}"
            yield Complaint(f"design.{key}", value_text(design[key]), text)


def no_such_channel(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Yield the channel of the rise time if the problem, as far as it is stated, has fewer."""
    problem, check = data.get("problem"), _table(data.get("checks")).get("rise_time")
    channel, most = _table(check).get("channel"), _table(problem).get("channels", 7)
    if _table(problem).get("kind") != "tactile":
        rows = _table(problem).get("matrix")
        most = (
            len(rows[0]) if isinstance(rows, list) and rows and isinstance(rows[0], list) else None
        )
    if isinstance(channel, int) and isinstance(most, int) and 0 < most < channel:
        text = f"the problem has {most} channels; expected 1 to {most}"
        yield Complaint("checks.rise_time.channel", value_text(channel), text)


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
