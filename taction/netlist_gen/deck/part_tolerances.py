"""Tolerances of the parts of a deck, from a small TOML file.

A kind counts outside of subcircuits; a name in ``[parts]``, with * and ? for any letters, anywhere.
"""

from __future__ import annotations

import difflib
import fnmatch
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

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
    ' distribution, and a table [parts] with R1 = "0.1%"'
)


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


def read_tolerances(file: str | Path, circuit: Circuit) -> Tolerances:
    r"""Return the tolerances of single parts, those above zero; all others are exact.

    `circuit`: of a deck.
    InputError: the file cannot be read, has a key or a value that is none, or names no part; all
      mistakes.
    """
    path, found, wrong = Path(file), _File(), list[Complaint]()
    data, _ = read_toml(path, ACCEPTED)
    table = data.get("tolerances", data)
    if not isinstance(table, dict):
        raise InputError(path, Complaint("tolerances", repr(table)[:80], f"expected {ACCEPTED}"))
    if "params" in table:
        text = "a .param has no tolerance any more; give its parts one in [parts]"
        raise InputError(path, Complaint("params", "", text))
    try:
        found = validated(_File, table, path)
    except InputError as error:
        wrong += error.complaints
    kinds = {key: kind for key, kind in varying_parts(circuit) if kind in _File.model_fields}
    lower = {name.lower(): name for name in kinds}
    named = table.get("parts")
    for key in named if isinstance(named, dict) else ():
        if not fnmatch.filter(lower, key.lower()):
            near = difflib.get_close_matches(key.lower(), lower, n=1, cutoff=0.0)
            more = f"; the nearest is {near[0]!r}" if near else "; it has none"
            text = f"no part of the deck has this name{more}"
            wrong.append(Complaint(f"parts.{key}", "", text))
    parts = {name: getattr(found, kind) for name, kind in kinds.items() if "." not in name}
    for key, share in found.parts.items():
        parts |= {lower[name]: share for name in fnmatch.filter(lower, key.lower())}
    parts = {name: share for name, share in parts.items() if share}
    for branch in circuit.branches:
        share, size = parts.get(branch.label, 0.0), abs(branch.value)
        if branch.letter == "K" and share and size * (1.0 + share) >= 1.0:
            most = 100.0 * (1.0 / size - 1.0)
            text = f"reaches 1 within its tolerance; expected less than {most:.2g} %"
            given = f"{branch.value:g} ± {100.0 * share:g} %"
            wrong.append(Complaint(branch.label, given, text))
    if not (wrong or parts):
        wrong.append(Complaint("tolerances", "", "nothing varies; expected " + ACCEPTED))
    if wrong:
        raise InputError(path, *wrong)
    exact = dict.fromkeys(("resistor", "capacitor", "stray", "opamp_gbw", "opamp_gain"), 0.0)
    return Tolerances(distribution=found.distribution, parts=parts, **exact)
