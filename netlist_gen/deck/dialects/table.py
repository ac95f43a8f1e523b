"""The table of dialects: to add one is to add a file and an entry.

An entry loads its dialect, so that a run of ngspice does not import the others.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module

from taction.netlist_gen.deck import dialects
from taction.netlist_gen.deck.dialects.dialect import Dialect

# The class of each dialect, in the module of its name.
CLASSES = {
    "ngspice": "Ngspice",
    "ltspice": "LTspice",
    "hspice": "HSPICE",
    "xyce": "Xyce",
    "spectre": "Spectre",
}


def _dialect(name: str) -> Dialect:
    made: Dialect = getattr(import_module(f"{dialects.__name__}.{name}"), CLASSES[name])()
    return made


DIALECTS: dict[str, Callable[[], Dialect]] = {name: partial(_dialect, name) for name in CLASSES}
