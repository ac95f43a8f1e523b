"""Test benches: one op-amp between a source and a load, as a circuit and as a deck.

The input ``in`` is held by a voltage source, or by a switched current through `OHMS`: 1 A is 1 V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from taction.netlist_gen.analysis import Analysis, Noise, SmallSignal, Transient
from taction.netlist_gen.board.circuit import (
    GROUND,
    NEEDED,
    Circuit,
    CurrentSource,
    OpAmpCell,
    Output,
    Resistor,
    VoltageSource,
    common_facts,
)
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.deck.measures import noise_cards
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import opamp_subcircuit

OHMS = 1.0  # of the source of a step
IN, OUT = "in", "out"
TIGHT = ".options noopiter reltol=1e-7 abstol=1e-18 vntol=1e-12 chgtol=1e-21 gmin=1e-18"
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
        noisy = isinstance(analysis, Noise)
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
        cards = [*lines, TIGHT, *self._cards(analysis), ".end", ""]
        return Deck("\n".join(cards), (OUT,), analysis)

    @staticmethod
    def _cards(analysis: Analysis) -> list[str]:
        save = f".save v({OUT})"
        if isinstance(analysis, Noise):
            return noise_cards(analysis, OUT)
        if isinstance(analysis, SmallSignal):
            band = analysis.band
            stop = band.stop * (1.0 + 1e-9)  # rounding could leave out the last frequency
            return [save, f".ac dec {band.density} {band.start!r} {stop!r}"]
        if isinstance(analysis, Transient):
            step = repr(analysis.max_step)
            return [save, f".tran {step} {analysis.stop!r} 0.0 {step} uic"]
        return [save, ".op"]

    def with_opamp(self, opamp: OpAmp) -> Bench:
        """Return the bench with another op-amp."""
        return replace(self, opamp=opamp)
