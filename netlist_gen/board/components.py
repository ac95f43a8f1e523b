"""The components of a board as plain data, with values and nodes, without SPICE.

Node ``"0"`` is ground. Matrices are arrays, never N² objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from taction.spice_models.imported import LinearModel
from taction.spice_models.opamp import OpAmp
from taction.spice_models.transistor import NOMINAL, Transistor
from taction.system.array_types import Bools, Floats

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

    `kind` is a key of `spice_models.amplifier.AMPLIFIERS` except ``"linear"``, an op-amp inverter.
    """

    name: str
    kind: str
    input: str
    output: str
    u_scale: float
    v_scale: float


@dataclass(frozen=True, slots=True)
class TransistorCell:
    """One transistor: `model` is a key of `Circuit.transistor_models`; the rest are node names."""

    name: str
    model: str
    collector: str
    base: str
    emitter: str


@dataclass(frozen=True, slots=True)
class Resistor:
    """A resistor between nodes `a` and `b`, ohm."""

    name: str
    a: str
    b: str
    ohms: float


@dataclass(frozen=True, slots=True)
class Capacitor:
    """A capacitor between nodes `a` and `b`, F; at t = 0 discharged or at rest."""

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
class NoiseCurrent:
    """A white noise current into `node`, of a `density` in A/rtHz over positive frequencies."""

    name: str
    node: str
    density: float


@dataclass(frozen=True, slots=True)
class VoltageSource:
    """A constant voltage from ground to `node`."""

    name: str
    node: str
    volts: float


@dataclass(frozen=True, slots=True, eq=False)
class ResistorMatrix:
    """An M-by-N matrix of resistors; element (k, n) has the name ``Rf_k_n``, counted from 1."""

    name: str  # "Rf" (forward) or "Rb" (feedback)
    ohms: Floats  # (M, N); infinite where there is no resistor
    negative: Bools  # (M, N): the entry of T is negative; a node of `minus` drives the resistor
    by_column: bool  # columns drive and rows sum (forward); else rows drive (feedback)
    plus: tuple[str, ...]  # driving nodes of positive entries
    minus: tuple[str, ...]  # driving nodes of negative entries, "" where there is no such entry
    sinks: tuple[str, ...]  # summing nodes, one per index of the other axis

    def elements(self) -> Iterator[tuple[int, int, str, str, float]]:
        """Yield ``(k, n, driving node, summing node, ohms)`` of every resistor by rows, from 0."""
        finite = np.isfinite(self.ohms)
        for k, n in zip(*(index.tolist() for index in np.nonzero(finite)), strict=True):
            drive, sink = (n, k) if self.by_column else (k, n)
            source = self.minus[drive] if self.negative[k, n] else self.plus[drive]
            yield k, n, source, self.sinks[sink], float(self.ohms[k, n])

    def resistors(self) -> Iterator[Resistor]:
        """Yield every resistor by rows; `a` is the driving node, `b` the summing node."""
        for k, n, source, sink, ohms in self.elements():
            yield Resistor(f"{self.name}_{k + 1}_{n + 1}", source, sink, ohms)


@dataclass(frozen=True, slots=True)
class Output:
    """The output of one channel: ``u = sign * V(node)``, V."""

    node: str
    sign: float


@dataclass(frozen=True, slots=True)
class Omission:
    """A part that the board omits because the scene does not need it."""

    what: str
    why: str


@dataclass(frozen=True, slots=True)
class Scalings:
    """The design's numbers, SI base units (design of the board: section 1 of the guide).

    `lam` is the regularisation parameter that follows from the components; `exponential_slope` is
    Ve (1 V, without effect, on a linear board), `capacitance` the preferred value of C.
    """

    unit_conductance: float
    unit_voltage: float
    exponential_slope: float
    resistance: float
    capacitance: float
    gain: float
    lam: float


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CircuitData:
    """All components of a board; `taction.netlist_gen.board.circuit.Circuit` also shows itself."""

    name: str
    amplifier: str
    topology: str
    scalings: Scalings
    models: dict[str, OpAmp]  # op-amp types by name
    opamps: tuple[OpAmpCell, ...]
    amplifiers: tuple[SignalAmplifier, ...]
    resistors: tuple[Resistor, ...]
    matrices: tuple[ResistorMatrix, ...]
    capacitors: tuple[Capacitor, ...]
    currents: tuple[CurrentSource, ...]
    voltages: tuple[VoltageSource, ...]
    signal_nodes: tuple[str, ...]  # nodes of v_n, one per channel
    constraint_nodes: tuple[str, ...]  # nodes of w_k, one per sensor
    outputs: tuple[Output, ...]  # u_n
    omissions: tuple[Omission, ...]
    supply: float = 15.0  # both supply voltages of the op-amps, ±V
    noises: tuple[NoiseCurrent, ...] = ()  # of the sensors; for noise analyses only
    transistors: tuple[TransistorCell, ...] = ()
    transistor_models: dict[str, Transistor] = field(default_factory=dict)  # types by name
    temperature: float = NOMINAL  # of the transistors, degrees C

    @property
    def is_small_signal(self) -> bool:
        """Whether no op-amp is at the large-signal level."""
        return not any(model.large_signal for model in self.models.values())

    @property
    def is_linear(self) -> bool:
        """Whether no signal amplifier is nonlinear, and no op-amp at the large-signal level."""
        return not self.has_nonlinear_amplifiers and self.is_small_signal

    @property
    def has_nonlinear_amplifiers(self) -> bool:
        """Whether signal amplifiers are behavioural, or have transistors."""
        return bool(self.amplifiers or self.transistors)

    @property
    def has_imported(self) -> bool:
        """Whether op-amps are a vendor's macromodel."""
        return any(model.imported is not None for model in self.models.values())

    def linear_model(self, cell: OpAmpCell) -> LinearModel | None:
        """Return the linear model of an imported op-amp; None for others, or where it has none."""
        imported = self.models[cell.model].imported
        return None if imported is None else imported.linear

    @property
    def has_constant_sources(self) -> bool:
        """Whether the board without strain may rest at other voltages than zero."""
        errors = any(model.input_errors for model in self.models.values())
        nonlinear = self.has_nonlinear_amplifiers
        return bool(self.voltages or nonlinear or errors or self.has_imported)
