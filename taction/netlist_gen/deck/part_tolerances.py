"""Tolerances of the parts of a deck, and of its ``.param`` cards, from a small TOML file.

A kind counts outside of subcircuits; a name in ``[parts]``, with * and ? for any letters, anywhere.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import varying_parts
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.fields import Model
from taction.netlist_gen.scene.loading import read_toml
from taction.netlist_gen.scene.mistakes import validated
from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction

LARGEST = 10.0  # of a tolerance: the value is up to 11 times as large
ACCEPTED = (
    'a file of tolerances in TOML: resistor = "1%", capacitor = "5%", coil, coupling, gain,'
    ' distribution, and tables [parts] with R1 = "0.1%" and [params] with the names of .param'
)


class DeckTolerances(NamedTuple):
    """Tolerances above zero: of parts, and of ``.param`` cards by their names in lower case."""

    parts: Tolerances
    params: Mapping[str, float] = MappingProxyType({})


def _share(value: object) -> float:
    """Return a fraction from ``"5%"`` or 0.05."""
    try:
        share = fraction(value)
    except ValueError:
        share = math.nan
    if not 0.0 <= share <= LARGEST:
        raise ValueError(f'expected a share from 0 to {LARGEST:g}, such as "5%" or 0.05')
    return share


Share = Annotated[float, BeforeValidator(_share)]


class _File(Model):
    """The keys of a file."""

    resistor: Share | None = None
    capacitor: Share | None = None
    coil: Share | None = None
    coupling: Share | None = None
    gain: Share | None = None
    distribution: Literal["normal", "uniform"] = "normal"
    parts: dict[str, Share] = Field(default_factory=dict)
    params: dict[str, Share] = Field(default_factory=dict)


KINDS = ("resistor", "capacitor", "coil", "coupling", "gain")


def read_tolerances(
    file: str | Path, circuit: Circuit, parameters: Sequence[str] = ()
) -> DeckTolerances:
    r"""Return the tolerances of single parts and parameters; all others are exact.

    `circuit`: of a deck.
    `parameters`: the names of its ``.param`` cards, in lower case.
    InputError: the file cannot be read, has a key or a value that is none, or names no part; all
      mistakes.
    """
    path = Path(file)
    data, _ = read_toml(path, ACCEPTED)
    table, found, wrong = data.get("tolerances", data), _File(), list[Complaint]()
    if not isinstance(table, dict):
        raise InputError(path, Complaint("tolerances", repr(table)[:80], f"expected {ACCEPTED}"))
    try:
        found = validated(_File, table, path)
    except InputError as error:
        wrong += error.complaints
    kinds = {key: kind for key, kind in varying_parts(circuit) if kind in KINDS}
    wrong += _unknown(table.get("parts"), "parts", {name.lower(): name for name in kinds})
    wrong += _unknown(table.get("params"), "params", {name: name for name in parameters})
    parts = {
        name: share
        for name, kind in kinds.items()
        if "." not in name and (share := getattr(found, kind)) is not None
    }
    for key, share in found.parts.items():
        hits = [name for name in kinds if fnmatchcase(name.lower(), key.lower())]
        parts |= dict.fromkeys(hits, share)
    parts = {name: share for name, share in parts.items() if share > 0.0}
    params = {key.lower(): share for key, share in found.params.items() if share > 0.0}
    for branch in circuit.branches:
        share = parts.get(branch.label, 0.0)
        if branch.letter == "K" and share > 0.0 and abs(branch.value) * (1.0 + share) >= 1.0:
            most = 100.0 * (1.0 / abs(branch.value) - 1.0)
            text = f"reaches 1 within its tolerance; expected less than {most:.2g} %"
            given = f"{branch.value:g} ± {100.0 * share:g} %"
            wrong.append(Complaint(branch.label, given, text))
    if wrong:
        raise InputError(path, *wrong)
    if not (parts or params):
        raise InputError(path, Complaint("tolerances", "", "nothing varies; expected " + ACCEPTED))
    exact = dict.fromkeys(("resistor", "capacitor", "stray", "opamp_gbw", "opamp_gain"), 0.0)
    spread = Tolerances(distribution=found.distribution, parts=parts, **exact)
    return DeckTolerances(spread, params)


def _unknown(named: Any, table: str, known: Mapping[str, str]) -> Iterator[Complaint]:
    """Yield the names of a table that the deck does not have; `known` are those in lower case."""
    what = {"parts": "part", "params": ".param"}[table]
    for key in named if isinstance(named, dict) else ():
        if not any(fnmatchcase(name, key.lower()) for name in known):
            near = difflib.get_close_matches(key.lower(), known, n=1, cutoff=0.0)
            more = f"; the nearest is {known[near[0]]!r}" if near else "; it has none"
            yield Complaint(f"{table}.{key}", "", f"no {what} of the deck has this name{more}")
