"""A test bench of one op-amp, for the state-space engine and for ngspice: what its limits do.

The input ``in`` is held by a voltage source, or by a switched current through `OHMS`: 1 A is 1 V.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import GROUND, NEEDED, Circuit, Output, common_facts
from taction.netlist_gen.board.parts import CurrentSource, OpAmpCell, Resistor, VoltageSource
from taction.netlist_gen.deck.deck import Deck
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.system.array_types import Floats
from taction.verification.characterise.characterise import slope, supply_of
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import simulate
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients.simulate import simulate as integrate

IN, OUT = "in", "out"
OHMS = 1.0  # of the source of a step
TIGHT = ".options noopiter reltol=1e-7 abstol=1e-18 vntol=1e-12 chgtol=1e-21 gmin=1e-18"
POINTS = 2000  # of a transient
STEP = 0.8  # of the swing: the step of a follower that slews
RAMP = (0.2, 0.5)  # of that step: where its slope is measured
SHORT = 1e-3  # ohm: the load that takes the largest current
OVERDRIVE = 20.0  # ranges of the input stage: the input of an open loop at its limits
SETTLED = 8.0  # periods of the unity-gain bandwidth
_UNITS = common_facts(**dict.fromkeys(NEEDED, 1.0))


@dataclass(frozen=True, slots=True)
class Bench:
    """One op-amp as a follower, or with its inverting input on ground: the open loop."""

    opamp: OpAmp
    supply: float = 15.0  # both supply voltages, ±V
    follower: bool = True
    step: float | None = None  # V, that switches on at t = 0; None for a source of 1 V
    load: float | None = None  # ohm, from the output to ground

    @property
    def circuit(self) -> Circuit:
        """The bench for the state-space engine."""
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


Witness = Callable[[Bench, float], tuple[Floats, Floats]]


def by_the_engine(bench: Bench, stop: float) -> tuple[Floats, Floats]:
    """Return instants (P,), s, and output voltages (P,), V, of a bench with a step."""
    times = np.linspace(0.0, stop, POINTS + 1)
    transient = Transient(stop, stop / POINTS)
    wave = integrate(LinearBoard(bench.circuit), transient, nodes=(OUT,), times=times)
    return wave.time, wave[OUT]


def by_ngspice(bench: Bench, stop: float) -> tuple[Floats, Floats]:
    """Return the same from ngspice."""
    assert bench.step is not None
    cell = opamp_subcircuit(bench.opamp, noninverting_grounded=False, supply=bench.supply)
    transient = Transient(stop, stop / POINTS)
    lines = [
        "* an op-amp on a test bench",
        str(cell).strip(),
        f"Xone {IN} {OUT if bench.follower else GROUND} {OUT} {bench.opamp.name}",
        f"Istep 0 {IN} {bench.step / OHMS!r}",
        f"Rsource {IN} 0 {OHMS!r}",
        *([] if bench.load is None else [f"Rload {OUT} 0 {bench.load!r}"]),
        TIGHT,
        f".save v({OUT})",
        f".tran {transient.max_step!r} {stop!r} 0.0 {transient.max_step!r} uic",
        ".end",
        "",
    ]
    wave = simulate(Deck("\n".join(lines), (OUT,), transient), find_simulator(), timeout=120.0)
    return wave.time, wave[OUT]


def limits(opamp: OpAmp, witness: Witness) -> dict[str, float]:
    """Measure slew rate, V/s, swing, V, and largest output current, A.

    The supply is the largest that the part allows, ±15 V at most.
    """
    supply = supply_of(opamp)
    limited, swing = replace(opamp.small_signal, input_errors=False, large_signal=True), opamp.swing
    rise, step = 2.0 * swing(supply) / opamp.slew_rate + SETTLED / opamp.gbw, STEP * swing(supply)
    time, volts = witness(Bench(limited, supply, step=step), rise)
    found = {"slew_rate": slope(time, volts, RAMP[0] * step, RAMP[1] * step)}
    driven = Bench(limited, supply, follower=False, step=OVERDRIVE * opamp.input_range)
    found["swing"] = float(witness(driven, 2.0 * rise)[1][-1])
    if opamp.has_largest_current:
        shorted = replace(driven, opamp=replace(limited, limits_current=True), load=SHORT)
        found["output_current"] = float(witness(shorted, 2.0 * rise)[1][-1]) / SHORT
    return found
