"""What a circuit must satisfy before it becomes text, and the tolerances its scales ask for."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator
from operator import attrgetter
from typing import Any

import numpy as np

from netlist_gen.analysis import Analysis, Tolerances, Transient
from netlist_gen.board.circuit import GROUND, Circuit

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
SCENE_NAME = re.compile(r"[A-Za-z0-9_.-]*")
FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")

_NAMES: dict[str, Callable[[Any], tuple[str, ...]]] = {  # what of a circuit's parts is a name
    "resistors": attrgetter("name", "a", "b"),
    "capacitors": attrgetter("name", "a", "b"),
    "opamps": attrgetter("name", "model", "noninverting", "inverting", "output"),
    "amplifiers": attrgetter("name", "input", "output"),
    "currents": attrgetter("name", "node"),
    "voltages": attrgetter("name", "node"),
}


def check_circuit(circuit: Circuit) -> None:
    """Prove that nothing in `circuit` can do harm in a deck.

    A newline in a name runs commands in ngspice, and 1/0 becomes 1e32 without a word.

    Raises
    ------
    ValueError
        A name that is not ``[A-Za-z][A-Za-z0-9_]*`` or a value that is not finite and above zero.
        No scene can cause it; it guards against circuits made by other means.
    """
    if not SCENE_NAME.fullmatch(circuit.name):
        raise ValueError(f"{circuit.name!r} is no name for a scene")
    for item in circuit.omissions:
        if not (item.what + item.why).isprintable():
            raise ValueError(f"{item!r} does not fit on a comment line")
    _check_names(_names(circuit))
    for kind in _NAMES:
        names = [part.name for part in getattr(circuit, kind)]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ValueError(f"two {kind} have the name {twice!r}")
    for resistor in circuit.resistors:
        _check_value(resistor.name, resistor.ohms)
    for capacitor in circuit.capacitors:
        _check_value(capacitor.name, capacitor.farads)
    for stage in circuit.amplifiers:
        _check_value(stage.name, stage.u_scale)
        _check_value(stage.name, stage.v_scale)
    for current in circuit.currents:
        _check_value(current.name, abs(current.amps))
    for voltage in circuit.voltages:
        _check_value(voltage.name, abs(voltage.volts))
    for matrix in circuit.matrices:
        if not np.all(matrix.ohms > 0):
            raise ValueError(f"matrix {matrix.name} has a resistance that is not above zero")


def _names(circuit: Circuit) -> Iterator[str]:
    """Every name of a part, a node or a model."""
    parts = [map(names, getattr(circuit, kind)) for kind, names in _NAMES.items()]
    matrices = [(m.name, *m.sinks, *m.plus, *filter(None, m.minus)) for m in circuit.matrices]
    own = [(circuit.amplifier, circuit.topology)]
    return itertools.chain.from_iterable(itertools.chain(own, *parts, matrices))


def check_request(
    analysis: Analysis, saved: Iterable[str], solver: str, matrix_file: str | None
) -> None:
    """Prove the same of what a deck asks for.

    Raises
    ------
    ValueError
        A node, an option or a file name that must not be in a deck, or a time that is not finite
        and above zero.
    """
    _check_names((*saved, solver))
    if matrix_file is not None and not FILE_NAME.fullmatch(matrix_file):
        raise ValueError(f"{matrix_file!r} is no file name for a deck: letters, digits, '_.-'")
    if isinstance(analysis, Transient):
        _check_value("stop", analysis.stop)
        _check_value("max_step", analysis.max_step)
        # a dot leads into a subcircuit, as in "xv_1.p1"
        _check_names(part for node in analysis.voltages for part in node.split("."))
        for node, volts in analysis.voltages.items():
            if not math.isfinite(volts):
                raise ValueError(f"the initial voltage of {node} is {volts!r}; it must be finite")


def tolerances(circuit: Circuit, relative: float) -> Tolerances:
    """Choose tolerances from the scales of `circuit`, so that 1e-12 S works as well as 1e-3 S.

    ngspice's own defaults (1 pA, 1 µV, 1e-14 C, 1e-12 S) would swamp the first.
    """
    scalings = circuit.scalings
    volts, siemens = scalings.unit_voltage, scalings.unit_conductance
    return Tolerances(
        relative=relative,
        current=1e-3 * relative * siemens * volts,
        voltage=1e-3 * relative * volts,
        charge=1e-3 * relative * scalings.capacitance * volts,
        gmin=1e-6 * relative * siemens,
    )


def _check_names(names: Iterable[str]) -> None:
    distinct = dict.fromkeys(names)  # most name a node, which several parts share
    distinct.pop(GROUND, None)
    if not all(map(NAME.fullmatch, distinct)):
        wrong = next(name for name in distinct if not NAME.fullmatch(name))
        raise ValueError(f"{wrong!r} is no name for a deck")


def _check_value(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} has the value {value!r}; it must be finite and above zero")
