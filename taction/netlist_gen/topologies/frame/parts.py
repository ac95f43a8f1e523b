"""The parts that a synthesis collects before it makes a `Circuit`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from taction.netlist_gen.board.circuit import GROUND, Circuit, Role
from taction.netlist_gen.board.parts import (
    Capacitor,
    CurrentSource,
    NoiseCurrent,
    OpAmpCell,
    Part,
    Resistor,
    ResistorMatrix,
    SignalAmplifier,
    TransistorCell,
    VoltageSource,
)
from taction.netlist_gen.board.preferred_values import preferred
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import OpAmp

KINDS = (
    *("opamps", "amplifiers", "transistors", "resistors", "matrices"),
    *("capacitors", "currents", "noises", "voltages"),
)


@dataclass(slots=True)
class Parts:
    """Parts by kind, in the order in which they were placed."""

    model: str  # op-amp type of every cell
    stray: float  # capacitance at every summing node, F
    inverter: float  # both resistors of every inverter, ohm
    series: str  # of the resistors
    opamps: list[OpAmpCell] = field(default_factory=list)
    amplifiers: list[SignalAmplifier] = field(default_factory=list)
    transistors: list[TransistorCell] = field(default_factory=list)
    resistors: list[Resistor] = field(default_factory=list)
    matrices: list[ResistorMatrix] = field(default_factory=list)
    capacitors: list[Capacitor] = field(default_factory=list)
    currents: list[CurrentSource] = field(default_factory=list)
    noises: list[NoiseCurrent] = field(default_factory=list)
    voltages: list[VoltageSource] = field(default_factory=list)
    roles: defaultdict[str, set[str]] = field(default_factory=lambda: defaultdict(set))

    def resistor(self, role: str, name: str, ends: tuple[str, str], ohms: float) -> None:
        """Place a resistor of the nearest value of the series."""
        part = Resistor(name, *ends, preferred(ohms, self.series))
        self.resistors.append(part)
        self.roles[role].add(part.card)

    def capacitor(self, role: str, name: str, ends: tuple[str, str], farads: float) -> None:
        """Place a capacitor of this value."""
        part = Capacitor(name, *ends, farads)
        self.capacitors.append(part)
        self.roles[role].add(part.card)

    def circuit(self, scene: Scene, model: OpAmp, **stated: Any) -> Circuit:
        """Return the board of these parts; `stated` are the other fields of `Circuit`."""
        parts: dict[str, Any] = {kind: tuple(getattr(self, kind)) for kind in KINDS}
        return Circuit(
            name=scene.name,
            amplifier=scene.design.amplifier,
            models={model.name: model},
            supply=scene.design.supply,
            roles={role: frozenset(names) for role, names in self.roles.items()},
            **parts,
            **stated,
        )

    def matrix(self, role: str, matrix: ResistorMatrix) -> None:
        """Place a matrix of resistors."""
        self.matrices.append(matrix)
        self.roles[role].add(matrix.name)

    @contextmanager
    def stated(self, role: str) -> Iterator[None]:
        """State all parts that are placed inside as parts with `role`, strays too."""
        kinds: tuple[Sequence[Part], ...] = (
            self.opamps,
            self.transistors,
            self.resistors,
            self.capacitors,
            self.voltages,
        )
        counts = [len(kind) for kind in kinds]
        yield
        for kind, count in zip(kinds, counts, strict=True):
            self.roles[role].update(part.card for part in kind[count:])

    def opamp(self, name: str, summing: str, output: str) -> None:
        """Place an op-amp that holds node `summing` at virtual ground, and its stray."""
        self.opamps.append(OpAmpCell(name, self.model, GROUND, summing, output))
        self.stray_at(summing)

    def stage(self, name: str, plus: str, minus: str, output: str) -> None:
        """Place an op-amp whose inputs are summing nodes or ground, and their strays."""
        self.opamps.append(OpAmpCell(name, self.model, plus, minus, output))
        for node in (plus, minus):
            if node != GROUND:
                self.stray_at(node)

    def follower(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain buffer from `source` to `output`."""
        self.opamps.append(OpAmpCell(name, self.model, source, output, output))

    def stray_at(self, node: str) -> None:
        """Place the stray capacitance of a summing node."""
        if self.stray > 0:
            self.capacitor(Role.STRAY, f"stray_{node}", (node, GROUND), self.stray)

    def inverting(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain inverter from `source` to `output` with the summing node j`output`."""
        summing = f"j{output}"
        self.opamp(name, summing, output)
        for end, node in (("in", source), ("fb", output)):
            self.resistor(Role.INVERTER_RESISTOR, f"{name}_{end}", (node, summing), self.inverter)
