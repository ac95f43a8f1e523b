"""The table of dialects: to add one is to add a file and an entry.

An entry loads its dialect, so that a run of ngspice does not import the others.
"""

from __future__ import annotations

from collections.abc import Callable

from taction.netlist_gen.deck.dialects.dialect import Dialect


def _ngspice() -> Dialect:
    from taction.netlist_gen.deck.dialects.ngspice import Ngspice

    return Ngspice()


def _ltspice() -> Dialect:
    from taction.netlist_gen.deck.dialects.ltspice import LTspice

    return LTspice()


def _hspice() -> Dialect:
    from taction.netlist_gen.deck.dialects.hspice import HSPICE

    return HSPICE()


def _xyce() -> Dialect:
    from taction.netlist_gen.deck.dialects.xyce import Xyce

    return Xyce()


def _spectre() -> Dialect:
    from taction.netlist_gen.deck.dialects.spectre import Spectre

    return Spectre()


DIALECTS: dict[str, Callable[[], Dialect]] = {
    "ngspice": _ngspice,
    "ltspice": _ltspice,
    "hspice": _hspice,
    "xyce": _xyce,
    "spectre": _spectre,
}
