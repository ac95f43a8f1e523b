"""Op-amp presets from ``presets.toml``, and presets with some figures changed."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from taction.spice_models.opamp import OpAmp, poles_from_phase_margin, second_pole_from_phase_margin

_NAMES = [each.name for each in fields(OpAmp)]
FIGURES = (*_NAMES[1 : _NAMES.index("channels_per_package") + 1], "phase_margin")
"""The figures that `derive` can change; SI base units, phase margin in degrees, rejection in dB."""


@cache
def _text() -> str:
    return (Path(__file__).parent / "presets.toml").read_text(encoding="utf-8")


@cache
def tables() -> dict[str, dict[str, Any]]:
    """Return the tables of the data file by name, each with the figures of the one it is `like`."""
    read = tomllib.loads(_text())
    return {name: read.get(table.get("like", ""), {}) | table for name, table in read.items()}


@cache
def load_presets() -> Mapping[str, OpAmp]:
    """Return the presets by name in the order of the data file, which is read once."""
    return MappingProxyType({name: opamp_of(name, table) for name, table in tables().items()})


def opamp_of(name: str, figures: Mapping[str, Any]) -> OpAmp:
    """Return the op-amp with the figures of a table as in ``presets.toml``.

    Raises
    ------
    ValueError
        A figure is out of its range, or two real poles cannot have the phase margin.

    Examples
    --------
    >>> acme = {"source": "Acme, A1", "dc_gain": 1e5, "unity_gain_bandwidth": 5e6}
    >>> opamp_of("acme1", acme).gbw
    5000000.0
    """
    table = {key: value for key, value in figures.items() if key not in ("origin", "like")}
    f_u = table.pop("unity_gain_bandwidth")
    table["guaranteed"] = tuple(table.get("guaranteed", {}).items())
    documents = _documents(figures).items()
    table["assumed"] = tuple(figure for figure, document in documents if document == "assumed")
    if "phase_margin" in table:
        poles = poles_from_phase_margin(table["dc_gain"], f_u, table.pop("phase_margin"))
        table["gbw"], table["second_pole"] = poles
    else:
        table["gbw"] = f_u
    return OpAmp(name=name, **table)


def _documents(table: Mapping[str, Any]) -> dict[str, str]:
    """Return the documents of figures and limits; a table without ``origin`` says none."""
    if "origin" not in table:
        return {}
    stated = table.keys() - {"source", "external_part", "guaranteed", "origin", "like"}
    limits = {f"guaranteed.{figure}" for figure in table.get("guaranteed", {})}
    lists = table["origin"].items()
    known = {figure: document for document, figures in lists for figure in figures}
    return dict.fromkeys(sorted(stated | limits), "assumed") | known


_NOTED = re.compile(r"(\w+)\s*=\s*[^#]*#\s*(.*)")
_CONTINUED = re.compile(r"\s+#\s*(.*)")


@cache
def _notes() -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    table, last = dict[str, str](), ""
    for line in _text().splitlines():
        if line.startswith("["):
            table = found[line.strip("[] ")] = {}
        elif noted := _NOTED.fullmatch(line):
            key, note = noted.groups()
            table[key] = table[last] if note == "likewise" else note
            last = key
        elif (more := _CONTINUED.fullmatch(line)) and last in table:
            table[last] += f" {more[1]}"
    return found


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a figure of a preset comes from."""

    # title and revision of the document that prints the figure, and its guaranteed limit;
    # ``"derived"`` from other figures as the note says, or ``"assumed"``: in no public text that
    # was found. Empty where there is no limit
    document: str
    limit: str
    note: str  # what the data file says beside it


def figure_origins(name: str) -> dict[str, Origin]:
    """Return where the figures of a preset come from, by their keys in the file.

    Nothing is known about an op-amp of another package.
    """
    table = tables().get(name, {})
    documents, notes = _documents(table), _notes().get(table.get("like", name), {})
    return {
        key: Origin(document, documents.get(f"guaranteed.{key}", ""), notes.get(key, ""))
        for key, document in documents.items()
        if not key.startswith("guaranteed.")
    }


def derive(base: OpAmp, name: str, **figures: float) -> OpAmp:
    """Return `base` under a new name with some figures changed.

    `figures` are some of `FIGURES`. A changed `gbw` keeps the ratio ``second_pole / gbw``, and so
    nearly the phase margin, unless `second_pole` or `phase_margin` is given too. A changed
    `dc_gain` moves only the first pole.

    ValueError: an unknown figure, a value out of its range, `second_pole` together with
      `phase_margin`, or a phase margin that two real poles cannot have.
    """
    unknown = sorted(set(figures) - set(FIGURES))
    if unknown:
        raise ValueError(f"{unknown[0]}: not a figure of an op-amp; known: {', '.join(FIGURES)}")
    if "second_pole" in figures and "phase_margin" in figures:
        raise ValueError("phase_margin: it sets second_pole; give one of the two")
    changed: dict[str, Any] = dict(figures)
    margin = changed.pop("phase_margin", None)
    if "gbw" in changed and "second_pole" not in changed and math.isfinite(base.second_pole):
        changed["second_pole"] = base.second_pole * (changed["gbw"] / base.gbw)
    source = base.source
    if figures:
        listed = ", ".join(f"{key} = {value!r}" for key, value in figures.items())
        source = f"{base.name} with {listed}; {source}"
    opamp = replace(base, name=name, source=source, large_signal=False, **changed)
    if margin is None:
        return opamp
    pole = second_pole_from_phase_margin(opamp.dc_gain, opamp.gbw, margin)
    return replace(opamp, second_pole=pole)


def opamp_name(name: str) -> str:
    """Return the name of an op-amp model in words.

    >>> opamp_name("ua741"), opamp_name("ideal_changed")
    ('ua741', 'ideal with changed figures')
    """
    base = name.removesuffix("_changed")
    return name if base == name else f"{base} with changed figures"
