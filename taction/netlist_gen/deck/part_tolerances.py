"""Tolerances of the parts of a deck, and of its ``.param`` cards, from a small TOML file.

```toml
resistor = "1%"          # every R outside of subcircuits; likewise capacitor, coil,
                         # coupling (K), gain (E F G H)
distribution = "uniform" # within the tolerance; by default normal: the tolerance is three sigma

[parts]                  # by name, as `taction check` lists them; * and ? stand for any letters
R1 = "0.1%"
"x*.C1" = "30%"

[params]                 # of a .param: all that depends on it moves together
gain = "2%"
```
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.loading import read_toml
from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction

if TYPE_CHECKING:
    from taction.netlist_gen.scene.checks import Tolerances

KINDS = ("resistor", "capacitor", "coil", "coupling", "gain")
DISTRIBUTIONS = ("normal", "uniform")
KEYS = (*KINDS, "distribution", "parts", "params")
LARGEST = 10.0  # of a tolerance: the value is up to 11 times as large
ACCEPTED = (
    'a file of tolerances in TOML: resistor = "1%", capacitor = "5%", coil, coupling, gain,'
    ' distribution, and tables [parts] with R1 = "0.1%" and [params] with the names of .param'
)


class DeckTolerances(NamedTuple):
    """Tolerances above zero: of parts, and of ``.param`` cards by their names in lower case."""

    parts: Tolerances
    params: Mapping[str, float] = MappingProxyType({})


def read_tolerances(
    file: str | Path, circuit: Circuit, parameters: Sequence[str] = ()
) -> DeckTolerances:
    r"""Return the tolerances of single parts and parameters; all others are exact.

    Parameters
    ----------
    circuit : Circuit
        Of a deck.
    parameters : sequence of str
        The names of its ``.param`` cards, in lower case.

    Raises
    ------
    InputError
        The file cannot be read, has a key or a value that is none, or names no part; all mistakes.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
    >>> flat = read_cards(["v1 in 0 1", "r1 in out 1k", "c1 out 0 1n", "c2 out 0 1n"])
    >>> circuit = circuit_of(flat, "rc", ["out"])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     place = pathlib.Path(folder, "parts.toml")
    ...     _ = place.write_text('capacitor = "5%"\n[parts]\nC2 = 0.2\n')
    ...     read_tolerances(place, circuit).parts.parts
    {'C1': 0.05, 'C2': 0.2}
    """
    path = Path(file)
    data, _ = read_toml(path, ACCEPTED)
    from taction.netlist_gen.scene.checks import Tolerances  # after the refusal of a file

    table, wrong = data.get("tolerances", data), list[Complaint]()
    if not isinstance(table, dict):
        raise InputError(path, Complaint("tolerances", repr(table)[:80], f"expected {ACCEPTED}"))
    for key in table.keys() - set(KEYS):
        near = difflib.get_close_matches(key, KEYS, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        wrong.append(Complaint(key, "", f"{hint}expected one of {', '.join(KEYS)}"))
    distribution = table.get("distribution", "normal")
    if distribution not in DISTRIBUTIONS:
        wrong.append(Complaint("distribution", repr(distribution), "expected normal or uniform"))
    kinds = {kind: _share(table[kind], kind, wrong) for kind in KINDS if kind in table}
    parts = _parts(circuit, kinds, table.get("parts", {}), wrong)
    params = _params(parameters, table.get("params", {}), wrong)
    wrong += _tight_couplings(circuit, parts)
    if wrong:
        raise InputError(path, *wrong)
    if not (parts or params):
        raise InputError(path, Complaint("tolerances", "", "nothing varies; expected " + ACCEPTED))
    exact = dict.fromkeys(("resistor", "capacitor", "stray", "opamp_gbw", "opamp_gain"), 0.0)
    return DeckTolerances(Tolerances(distribution=distribution, parts=parts, **exact), params)


def _parts(
    circuit: Circuit, kinds: Mapping[str, float], named: Any, wrong: list[Complaint]
) -> dict[str, float]:
    """Return the tolerances above zero by the names of parts; mistakes are added to `wrong`."""
    from taction.netlist_gen.board.variation import varying_parts

    known = {name: kind for name, kind in varying_parts(circuit) if kind in KINDS}
    found = {name: kinds[kind] for name, kind in known.items() if kind in kinds and "." not in name}
    if not isinstance(named, dict):
        wrong.append(Complaint("parts", repr(named)[:80], 'expected a table: [parts], R1 = "1%"'))
        named = {}
    folded = {name.lower(): name for name in known}
    for key, value in named.items():
        share = _share(value, f"parts.{key}", wrong)
        hits = [folded[name] for name in folded if fnmatchcase(name, key.lower())]
        found |= dict.fromkeys(hits, share)
        if not hits:
            near = difflib.get_close_matches(key.lower(), folded, n=1, cutoff=0.0)
            text = "no part of the deck has this name"
            more = f"; the nearest is {folded[near[0]]!r}" if near else ""
            wrong.append(Complaint(f"parts.{key}", "", text + more))
    return {name: share for name, share in found.items() if share > 0.0}


def _params(parameters: Sequence[str], named: Any, wrong: list[Complaint]) -> dict[str, float]:
    """Return the tolerances above zero of ``.param`` cards; mistakes are added to `wrong`."""
    if not isinstance(named, dict):
        wrong.append(
            Complaint("params", repr(named)[:80], 'expected a table: [params], gain = "1%"')
        )
        return {}
    found = dict[str, float]()
    for key, value in named.items():
        share = _share(value, f"params.{key}", wrong)
        if key.lower() not in parameters:
            listed = f"it has {', '.join(parameters)}" if parameters else "it has none"
            text = f"the deck has no .param of this name; {listed}"
            wrong.append(Complaint(f"params.{key}", "", text))
        elif share > 0.0:
            found[key.lower()] = share
    return found


def _tight_couplings(circuit: Circuit, parts: Mapping[str, float]) -> Iterator[Complaint]:
    """Yield couplings that reach 1 within their tolerance."""
    for branch in circuit.branches:
        share = parts.get(branch.label, 0.0)
        if branch.letter == "K" and share > 0.0 and abs(branch.value) * (1.0 + share) >= 1.0:
            most = 100.0 * (1.0 / abs(branch.value) - 1.0)
            text = f"reaches 1 within its tolerance; expected less than {most:.2g} %"
            yield Complaint(branch.label, f"{branch.value:g} ± {100.0 * share:g} %", text)


def _share(value: object, key: str, wrong: list[Complaint]) -> float:
    """Return a fraction from ``"5%"`` or 0.05; 0 for a mistake, which is added to `wrong`."""
    try:
        share = fraction(value)
    except ValueError:
        share = math.nan
    if not 0.0 <= share <= LARGEST:
        text = f'expected a share from 0 to {LARGEST:g}, such as "5%" or 0.05'
        wrong.append(Complaint(key, repr(value)[:80], text))
        return 0.0
    return share
