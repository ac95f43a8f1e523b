"""Test benches: one op-amp between a source and a load, as a circuit and as a deck.

The input ``in`` is held by a voltage source, or by a switched current through `OHMS`: 1 A is 1 V.
A vendor's subcircuit, whose offset would drive an open loop to its limit, has a bench that holds
its operating point (`VendorBench`), and only as a deck.
"""

from __future__ import annotations

from dataclasses import dataclass

from taction.netlist_gen.analysis import Analysis, NoiseAnalysis, SmallSignal, Transient
from taction.netlist_gen.board.circuit import GROUND, NEEDED, Circuit, Output, common_facts
from taction.netlist_gen.board.parts import CurrentSource, OpAmpCell, Resistor, VoltageSource
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.deck.measures import noise_cards
from taction.spice_models.foreign_netlist import Subcircuit
from taction.spice_models.imported import instance
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import opamp_subcircuit

OHMS = 1.0  # of the source of a step
IN, OUT = "in", "out"
VENDOR = (
    ".options reltol=1e-6 abstol=1e-15 vntol=1e-9",
    ".options reltol=1e-5 abstol=1e-13 vntol=1e-7",
    ".options reltol=1e-4",
)
"""Options of vendors' models, tried in this order: not every model converges with the first."""
TIGHT = ".options noopiter reltol=1e-7 abstol=1e-18 vntol=1e-12 chgtol=1e-21 gmin=1e-18"
SWITCHED = (
    ".options reltol=1e-4",
    ".options reltol=1e-3 gmin=1e-9",
    ".options reltol=1e-2 method=gear abstol=1e-9 vntol=1e-4",
)
"""Options for the large steps of vendors' models, likewise."""
SERVO = ("Gslow 0 slow out 0 1e-6", "Rslow slow 0 1e6", "Cslow slow 0 1e9")
PROBES = {"of_inn": "Vinn 1.0", "of_inp": "Vinp -1.0", "of_vcc": "Vcc -1.0"}
"""Nodes whose voltage is a current of the op-amp, A: into an input, and the supply's."""
CLAMPED = 100.0  # ohm, between the source of a large step and diodes at the input
LOAD = 10e3  # ohm, of a vendor's op-amp at its largest output
_UNITS = common_facts(**dict.fromkeys(NEEDED, 1.0))


@dataclass(frozen=True, slots=True)
class Bench:
    """One op-amp on a test bench.

    Attributes
    ----------
    opamp : OpAmp
        With the level and the errors that are to be measured.
    supply : float
        Both supply voltages, ±V.
    follower : bool
        Whether the output is the inverting input; else that is on ground: the open loop.
    step : float or None
        Voltage that switches on at t = 0, V; None for a source of 0 V, 1 V for small signals.
    load : float or None
        Resistor from the output to ground, ohm.
    """

    opamp: OpAmp
    supply: float = 15.0
    follower: bool = True
    step: float | None = None
    load: float | None = None

    @property
    def circuit(self) -> Circuit:
        """The bench for the state-space engine; a source without a step has 1 V."""
        switched = self.step is not None
        resistors = [Resistor("source", IN, GROUND, OHMS)] if switched else []
        if self.load is not None:
            resistors.append(Resistor("load", OUT, GROUND, self.load))
        return Circuit(
            name="bench",
            amplifier="linear",
            topology="bench",
            facts=_UNITS,
            models={self.opamp.name: self.opamp},
            opamps=(OpAmpCell("one", self.opamp.name, IN, OUT if self.follower else GROUND, OUT),),
            amplifiers=(),
            resistors=tuple(resistors),
            matrices=(),
            capacitors=(),
            currents=(CurrentSource("step", IN, self.step / OHMS),) if self.step else (),
            voltages=() if switched else (VoltageSource("source", IN, 1.0),),
            signal_nodes=(),
            constraint_nodes=(),
            outputs=(Output(OUT, 1.0),),
            omissions=(),
            supply=self.supply,
        )

    def deck(self, analysis: Analysis) -> Deck:
        """Return the bench as a deck for ngspice."""
        noisy = isinstance(analysis, NoiseAnalysis)
        cell = opamp_subcircuit(
            self.opamp, noninverting_grounded=False, supply=self.supply, noisy=noisy
        )
        inverting = OUT if self.follower else GROUND
        lines = ["* an op-amp on a test bench", str(cell).strip()]
        lines.append(f"Xone {IN} {inverting} {OUT} {self.opamp.name}")
        if self.step is None:
            lines.append(f"Vsource {IN} 0 0.0 ac 1.0")
        else:
            lines += [f"Istep 0 {IN} {self.step / OHMS!r}", f"Rsource {IN} 0 {OHMS!r}"]
        if self.load is not None:
            lines.append(f"Rload {OUT} 0 {self.load!r}")
        return _deck([*lines, TIGHT], analysis, (OUT,))


@dataclass(frozen=True, slots=True)
class VendorBench:
    """A vendor's subcircuit at the operating point of a follower, with open loop otherwise.

    The voltage of the inverting input is that of a node which follows the output with a time
    constant of 1e15 s: a follower at rest, and an open loop at every frequency above 1 uHz. A coil
    of 1e12 H and a capacitor of 1e12 F would be the same, but the admittance of that capacitor
    stands in the equations of the op-amp, and its rounding spoils the output of a large gain.
    """

    subcircuit: Subcircuit
    pins: tuple[str, ...]  # the role of each port
    supply: float  # of each supply voltage, from the middle, V
    compensation: float = 0.0  # capacitor between the ports `comp`, F
    options: str = VENDOR[0]
    middle: float = 0.0  # of the supplies: the non-inverting input at rest, V

    def deck(self, analysis: Analysis, excited: str = "", step: str = "") -> Deck:
        """Return the deck of an analysis.

        Parameters
        ----------
        analysis : Analysis
            What ngspice computes.
        excited : str
            Where a small signal of 1 V or 1 A is: ``"inn"``, ``"inp"`` or ``"out"``.
        step : str
            The voltage at the non-inverting input over the time; then the output has a load, to
            the middle of the supplies.
        """
        wired = tuple("pin" if role == "inn" else role for role in self.pins)
        size = {place: float(place == excited) for place in ("inp", "inn", "out")}
        lines = [
            "* test bench of an imported op-amp",
            *self.subcircuit.lines,
            f"Vcc vcc 0 dc {self.middle + self.supply!r}",
            f"Vee vee 0 dc {self.middle - self.supply!r}",
            f"Vmid mid 0 dc {self.middle!r}",
            f"Vinp {'far' if step else 'inp'} mid dc 0.0 ac {size['inp']!r} {step}".rstrip(),
            instance(self.subcircuit, wired, self.compensation),
            "Vinn inn pin dc 0.0",  # its current is that of the pin
            self.options,
            *SERVO,
            "Eservo inn drive slow 0 1.0",
            f"Vdrive drive 0 dc 0.0 ac {size['inn']!r}",
            f"Iload 0 out dc 0.0 ac {size['out']!r}",
            *([f"Rload out mid {LOAD!r}", f"Rstep far inp {CLAMPED!r}"] if step else []),
            *(f"H{node} {node} 0 {source}" for node, source in PROBES.items()),
        ]
        return _deck(lines, analysis, (OUT, "inn", *PROBES))


def _deck(lines: list[str], analysis: Analysis, saved: tuple[str, ...]) -> Deck:
    """Return a deck with the cards of its analysis."""
    save = ".save " + " ".join(f"v({node})" for node in saved)
    cards = [save, ".op"]
    if isinstance(analysis, NoiseAnalysis):
        cards = noise_cards(analysis, OUT)
    elif isinstance(analysis, SmallSignal):
        band = analysis.band
        stop = band.stop * (1.0 + 1e-9)  # rounding could leave out the last frequency
        cards = [save, f".ac dec {band.density} {band.start!r} {stop!r}"]
    elif isinstance(analysis, Transient):
        step = repr(analysis.max_step)
        start = " uic" if analysis.initial == "zero" else ""
        cards = [save, f".tran {step} {analysis.stop!r} 0.0 {step}{start}"]
    return Deck("\n".join([*lines, *cards, ".end", ""]), saved, analysis)
