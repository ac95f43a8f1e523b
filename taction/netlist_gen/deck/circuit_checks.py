"""Checks of a circuit before it becomes text, and tolerances that follow from its scales."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import fields

import numpy as np

from taction.netlist_gen.analysis import Analysis, NoiseAnalysis, SimulatorTolerances, Transient
from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import VoltageSource
from taction.spice_models.transistor import ZERO_CELSIUS

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
SCENE_NAME = re.compile(r"[A-Za-z0-9_.-]*")
# S and A: ngspice's default conductance, at which a vendor's model converges and was measured, and
# the tolerance of its bench; a board's own tolerances are below the rounding of its junctions.
VENDORS_GMIN, VENDORS_AMPS = 1e-12, 1e-15
FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")

KINDS = (
    *("resistors", "capacitors", "opamps", "amplifiers", "transistors"),
    *("currents", "noises", "voltages"),
)
SIGNED = ("currents", "voltages")
"""Fields of a circuit that hold parts: their texts are names, and their numbers values."""


def check_circuit(circuit: Circuit) -> None:
    """Raise ValueError for a name or a value that must not reach a simulator.

    No circuit that was made from a scene has one. ngspice runs a line after a newline in a name as
    a command, and reads 1/0 as 1e32.
    """
    if not SCENE_NAME.fullmatch(circuit.name):
        raise ValueError(f"{circuit.name!r} is not a valid name of a scene")
    for item in circuit.omissions:
        if not (item.what + item.why).isprintable():
            raise ValueError(f"{item!r} has characters that a comment line cannot hold")
    names = [circuit.amplifier, circuit.topology]
    for kind in KINDS:
        parts = getattr(circuit, kind)
        own = [part.name for part in parts]
        for field in fields(parts[0]) if parts else ():
            values = [getattr(part, field.name) for part in parts]
            if isinstance(values[0], str):
                names += values
            elif isinstance(values[0], float):
                for name, value in zip(own, values, strict=True):
                    _check_value(name, abs(value) if kind in SIGNED else value)
        if len(set(own)) != len(own):
            twice = next(name for name in own if own.count(name) > 1)
            raise ValueError(f"two {kind} have the name {twice!r}")
    for matrix in circuit.matrices:
        names += [matrix.name, *matrix.sinks, *matrix.plus, *filter(None, matrix.minus)]
        if not np.all(matrix.ohms > 0):
            raise ValueError(f"matrix {matrix.name} has a resistance that is not above zero")
    _check_names(names)
    _check_value("the absolute temperature", circuit.temperature + ZERO_CELSIUS)


def check_request(
    analysis: Analysis, saved: Sequence[str], solver: str, matrix_file: str | None
) -> None:
    """Raise ValueError for a node, option, file name or time that no deck may contain."""
    _check_names((*saved, solver))
    if matrix_file is not None and not FILE_NAME.fullmatch(matrix_file):
        raise ValueError(f"{matrix_file!r}: a file name in a deck has only letters, digits, '_.-'")
    if isinstance(analysis, NoiseAnalysis):
        if len(saved) != 1:
            raise ValueError("a noise analysis has one node, since ngspice does not name the nodes")
        for band in analysis.bands:
            for name in ("start", "steps", "density"):
                _check_value(name, getattr(band, name))
    if isinstance(analysis, Transient):
        _check_value("stop", analysis.stop)
        _check_value("max_step", analysis.max_step)
        _check_value("truncation", analysis.truncation)
        _check_value("first_step", analysis.begin)
        _check_value("charge", 1.0 if analysis.charge is None else analysis.charge)
        # a dot separates a subcircuit from its node, as in "xv_1.p1"
        _check_names(part for node in analysis.voltages for part in node.split("."))
        for node, volts in analysis.voltages.items():
            if not math.isfinite(volts):
                raise ValueError(f"the initial voltage of {node} is {volts!r}; it must be finite")


def tolerances(circuit: Circuit, relative: float) -> SimulatorTolerances:
    """Return tolerances that follow from the scales of `circuit`, for 1e-12 S as for 1e-3 S.

    ngspice's own defaults (1 pA, 1 µV, 1e-14 C, 1e-12 S) are too coarse for 1e-12 S. The step
    control takes the tolerance of currents for the error of a capacitor's current, so it follows
    from the strain currents, whatever the units of matrix and strain are.
    """
    volts, siemens = circuit.value("U0"), circuit.value("G0")
    each = (
        siemens * source.volts if isinstance(source, VoltageSource) else source.amps
        for source in circuit.strains
    )
    amps = max(map(abs, each), default=0.0) or siemens * volts
    return SimulatorTolerances(
        relative=relative,
        current=max(1e-3 * relative * amps, VENDORS_AMPS * circuit.has_imported),
        voltage=1e-3 * relative * volts,
        charge=1e-3 * relative * circuit.charged_capacitance * volts,
        gmin=1e-6 * relative * siemens,
        junction=VENDORS_GMIN if circuit.has_imported else 1e-6 * relative * siemens,
    )


def _check_names(names: Iterable[str]) -> None:
    distinct = dict.fromkeys(names)  # each node occurs in several parts
    distinct.pop(GROUND, None)
    if not all(map(NAME.fullmatch, distinct)):
        wrong = next(name for name in distinct if not NAME.fullmatch(name))
        raise ValueError(f"{wrong!r} is not a valid name in a deck")


def _check_value(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} has the value {value!r}; it must be finite and above zero")
