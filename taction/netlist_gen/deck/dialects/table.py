"""The table of dialects: to add one is to add a file and an entry.

An entry loads its dialect, so that a run of ngspice does not import the others.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module

from taction.netlist_gen.deck import dialects
from taction.netlist_gen.deck.dialects.dialect import Dialect
from taction.system.errors import Complaint, InputError

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


def refuse_unable(name: str, *, parameters: bool, measures: bool) -> None:
    """Refuse a name that is no dialect, and what a dialect does not have.

    Raises
    ------
    InputError
        It says which dialects have it.
    """
    if name not in DIALECTS:
        text = f"expected one of {', '.join(DIALECTS)}"
        raise InputError("netlist", Complaint("dialect", repr(name), text))
    dialect = DIALECTS[name]()
    wanted = {
        "--parameters": (parameters, "parameters"),
        "--measure": (measures, "measures"),
    }
    complaints = list[Complaint]()
    for option, (asked, what) in wanted.items():
        if asked and not getattr(dialect, what):
            able = [other for other, load in DIALECTS.items() if getattr(load(), what)]
            text = f"no free program checks the {what} of this dialect; expected {', '.join(able)}"
            complaints.append(Complaint("--dialect", name, f"{option}: {text}"))
    if complaints:
        raise InputError("netlist", *complaints)
