"""The parts that a synthesis collects before it makes a `Circuit`."""

from __future__ import annotations

from dataclasses import dataclass, field

from taction.netlist_gen.board.circuit import (
    GROUND,
    Capacitor,
    CurrentSource,
    NoiseCurrent,
    OpAmpCell,
    Resistor,
    ResistorMatrix,
    SignalAmplifier,
    TransistorCell,
    VoltageSource,
)


@dataclass(slots=True)
class Parts:
    """Parts by kind, in the order in which they were placed."""

    model: str  # op-amp type of every cell
    stray: float  # capacitance at every summing node, F
    inverter: float  # both resistors of every inverter, ohm
    opamps: list[OpAmpCell] = field(default_factory=list)
    amplifiers: list[SignalAmplifier] = field(default_factory=list)
    transistors: list[TransistorCell] = field(default_factory=list)
    resistors: list[Resistor] = field(default_factory=list)
    matrices: list[ResistorMatrix] = field(default_factory=list)
    capacitors: list[Capacitor] = field(default_factory=list)
    currents: list[CurrentSource] = field(default_factory=list)
    noises: list[NoiseCurrent] = field(default_factory=list)
    voltages: list[VoltageSource] = field(default_factory=list)

    def opamp(self, name: str, summing: str, output: str) -> None:
        """Place an op-amp that holds node `summing` at virtual ground, and its stray."""
        self.opamps.append(OpAmpCell(name, self.model, GROUND, summing, output))
        self.stray_at(summing)

    def follower(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain buffer from `source` to `output`."""
        self.opamps.append(OpAmpCell(name, self.model, source, output, output))

    def stray_at(self, node: str) -> None:
        """Place the stray capacitance of a summing node."""
        if self.stray > 0:
            self.capacitors.append(Capacitor(f"stray_{node}", node, GROUND, self.stray))

    def inverting(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain inverter from `source` to `output` with the summing node j`output`."""
        summing = f"j{output}"
        self.opamp(name, summing, output)
        self.resistors.append(Resistor(f"{name}_in", source, summing, self.inverter))
        self.resistors.append(Resistor(f"{name}_fb", output, summing, self.inverter))
