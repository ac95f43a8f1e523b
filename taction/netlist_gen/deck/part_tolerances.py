"""Tolerances of the parts of a deck, and of its ``.param`` cards, from a small TOML file.

A kind counts outside of subcircuits; a name in ``[parts]``, with * and ? for any letters, anywhere.
"""

from __future__ import annotations

import difflib
import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import varying_parts
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.fields import Model
from taction.netlist_gen.scene.mistakes import validated
from taction.netlist_gen.scene.scene import read_toml
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
    with suppress(ValueError):
        if 0.0 <= (share := fraction(value)) <= LARGEST:
            return share
    raise ValueError(f'expected a share from 0 to {LARGEST:g}, such as "5%" or 0.05')


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


def read_tolerances(
    file: str | Path, circuit: Circuit, parameters: Sequence[str] = ()
) -> DeckTolerances:
    r"""Return the tolerances of single parts and parameters; all others are exact.

    `circuit`: of a deck.
    `parameters`: the names of its ``.param`` cards, in lower case.
    InputError: the file cannot be read, has a key or a value that is none, or names no part; all
      mistakes.
    """
    path, found, wrong = Path(file), _File(), list[Complaint]()
    data, _ = read_toml(path, ACCEPTED)
    table = data.get("tolerances", data)
    if not isinstance(table, dict):
        raise InputError(path, Complaint("tolerances", repr(table)[:80], f"expected {ACCEPTED}"))
    try:
        found = validated(_File, table, path)
    except InputError as error:
        wrong += error.complaints
    kinds = {key: kind for key, kind in varying_parts(circuit) if kind in _File.model_fields}
    lower = {name.lower(): name for name in kinds}
    wrong += _unknown(table, "parts", "part", lower)
    wrong += _unknown(table, "params", ".param", {name: name for name in parameters})
    parts = {name: getattr(found, kind) for name, kind in kinds.items() if "." not in name}
    for key, share in found.parts.items():
        parts |= {lower[name]: share for name in fnmatch.filter(lower, key.lower())}
    parts = {name: share for name, share in parts.items() if share}
    params = {key.lower(): share for key, share in found.params.items() if share}
    for branch in circuit.branches:
        share, size = parts.get(branch.label, 0.0), abs(branch.value)
        if branch.letter == "K" and share and size * (1.0 + share) >= 1.0:
            most = 100.0 * (1.0 / size - 1.0)
            text = f"reaches 1 within its tolerance; expected less than {most:.2g} %"
            given = f"{branch.value:g} ± {100.0 * share:g} %"
            wrong.append(Complaint(branch.label, given, text))
    if not (wrong or parts or params):
        wrong.append(Complaint("tolerances", "", "nothing varies; expected " + ACCEPTED))
    if wrong:
        raise InputError(path, *wrong)
    exact = dict.fromkeys(("resistor", "capacitor", "stray", "opamp_gbw", "opamp_gain"), 0.0)
    spread = Tolerances(distribution=found.distribution, parts=parts, **exact)
    return DeckTolerances(spread, params)


def _unknown(
    tables: dict[str, Any], table: str, what: str, known: Mapping[str, str]
) -> Iterator[Complaint]:
    """Yield the names of a table that the deck does not have; `known` are those in lower case."""
    named = tables.get(table)
    for key in named if isinstance(named, dict) else ():
        if not fnmatch.filter(known, key.lower()):
            near = difflib.get_close_matches(key.lower(), known, n=1, cutoff=0.0)
            more = f"; the nearest is {known[near[0]]!r}" if near else "; it has none"
            yield Complaint(f"{table}.{key}", "", f"no {what} of the deck has this name{more}")
