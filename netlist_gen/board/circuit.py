"""`Circuit`: the board as plain data; components with values and nodes, no SPICE.

Everything downstream of the synthesis starts here: the deck writer turns it into text, the
state-space engine stamps it into equations. Node ``"0"`` is ground. Matrices are arrays, never
N² objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Bools, Floats
from spice_models.opamp import OpAmp

GROUND = "0"


@dataclass(frozen=True, slots=True)
class OpAmpCell:
    """One op-amp: `model` is a key of `Circuit.models`; the rest are node names."""

    name: str
    model: str
    noninverting: str
    inverting: str
    output: str


@dataclass(frozen=True, slots=True)
class SignalAmplifier:
    """A behavioural amplifier, ideal and inverting: ``V(output) = -u_scale g(V(input) / v_scale)``.

    `kind` is a key of `spice_models.amplifier.AMPLIFIERS` (any but ``"linear"``, which is an
    op-amp inverter).
    """

    name: str
    kind: str
    input: str
    output: str
    u_scale: float
    v_scale: float


@dataclass(frozen=True, slots=True)
class Resistor:
    """A resistor between nodes `a` and `b`, ohm."""

    name: str
    a: str
    b: str
    ohms: float


@dataclass(frozen=True, slots=True)
class Capacitor:
    """A capacitor between nodes `a` and `b`, F; discharged at t = 0 unless started from rest."""

    name: str
    a: str
    b: str
    farads: float


@dataclass(frozen=True, slots=True)
class CurrentSource:
    """A current of `amps` into `node` (out of ground), switched on at t = 0."""

    name: str
    node: str
    amps: float


@dataclass(frozen=True, slots=True)
class VoltageSource:
    """A constant voltage from ground to `node`, on for all time."""

    name: str
    node: str
    volts: float


@dataclass(frozen=True, slots=True, eq=False)
class ResistorMatrix:
    """An M-by-N matrix of resistors.

    Attributes
    ----------
    name : str
        ``"Rf"`` (forward) or ``"Rb"`` (feedback); element (k, n) is called ``Rf_k_n``, from 1.
    ohms : ndarray (M, N)
        Infinite where there is no resistor.
    negative : ndarray (M, N) of bool
        Where the entry of T is negative: driven from `minus` instead of `plus`.
    by_column : bool
        True: columns drive and rows are the sinks (forward); False: rows drive (feedback).
    plus, minus : tuple of str
        Driving nodes for positive and for negative entries, one per driving index; `minus`
        holds an empty name where no entry of that index is negative.
    sinks : tuple of str
        Summing nodes, one per index of the other axis.
    """

    name: str
    ohms: Floats
    negative: Bools
    by_column: bool
    plus: tuple[str, ...]
    minus: tuple[str, ...]
    sinks: tuple[str, ...]

    def elements(self) -> Iterator[tuple[int, int, str, str, float]]:
        """Row-major ``(k, n, driving node, summing node, ohms)`` of every resistor, from 0."""
        finite = np.isfinite(self.ohms)
        for k, n in zip(*(index.tolist() for index in np.nonzero(finite)), strict=True):
            drive, sink = (n, k) if self.by_column else (k, n)
            source = self.minus[drive] if self.negative[k, n] else self.plus[drive]
            yield k, n, source, self.sinks[sink], float(self.ohms[k, n])


@dataclass(frozen=True, slots=True)
class Output:
    """Where u of one channel is found: ``u = sign * V(node)``, volts."""

    node: str
    sign: float


@dataclass(frozen=True, slots=True)
class Omission:
    """Something the scene does not need and that was therefore left out."""

    what: str
    why: str


@dataclass(frozen=True, slots=True)
class Scalings:
    """The design's numbers, SI base units (design of the board: section 1 of the guide).

    `lam` is the regularisation parameter that the components imply; `exponential_slope` is Ve
    (1 V for a linear board, where it plays no part).
    """

    unit_conductance: float
    unit_voltage: float
    exponential_slope: float
    resistance: float
    capacitance: float
    gain: float
    lam: float


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Circuit:
    """A whole board.

    Attributes
    ----------
    models : dict of str to OpAmp
        The op-amp types in use, by name.
    signal_nodes : tuple of str
        The node whose voltage is v_n (up to sign for no topology: it is +v_n), one a channel.
    constraint_nodes : tuple of str
        The node whose voltage is w_k, one a sensor.
    outputs : tuple of Output
        Where u_n is read.
    omissions : tuple of Omission
        What was left out, and why.
    """

    name: str
    amplifier: str
    topology: str
    scalings: Scalings
    models: dict[str, OpAmp]
    opamps: tuple[OpAmpCell, ...]
    amplifiers: tuple[SignalAmplifier, ...]
    resistors: tuple[Resistor, ...]
    matrices: tuple[ResistorMatrix, ...]
    capacitors: tuple[Capacitor, ...]
    currents: tuple[CurrentSource, ...]
    voltages: tuple[VoltageSource, ...]
    signal_nodes: tuple[str, ...]
    constraint_nodes: tuple[str, ...]
    outputs: tuple[Output, ...]
    omissions: tuple[Omission, ...]

    def __repr__(self) -> str:
        size = f"{len(self.outputs)} channels, {len(self.constraint_nodes)} sensors"
        return f"Circuit({self.name!r}, {size}, {self.topology}, {self.amplifier} amplifiers)"
