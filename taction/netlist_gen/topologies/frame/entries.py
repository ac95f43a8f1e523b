"""What every topology does with the entries of T and the strain: the parts it collects."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taction.netlist_gen.board import parts as boards
from taction.netlist_gen.board.bill_of_materials import nearest, preferred
from taction.netlist_gen.board.circuit import GROUND, Circuit, Fact, Omission, Role
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Bools, Floats
from taction.system.quantities import spaced

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
    opamps: list[boards.OpAmpCell] = field(default_factory=list)
    amplifiers: list[boards.SignalAmplifier] = field(default_factory=list)
    transistors: list[boards.TransistorCell] = field(default_factory=list)
    resistors: list[boards.Resistor] = field(default_factory=list)
    matrices: list[boards.ResistorMatrix] = field(default_factory=list)
    capacitors: list[boards.Capacitor] = field(default_factory=list)
    currents: list[boards.CurrentSource] = field(default_factory=list)
    noises: list[boards.NoiseCurrent] = field(default_factory=list)
    voltages: list[boards.VoltageSource] = field(default_factory=list)
    roles: defaultdict[str, set[str]] = field(default_factory=lambda: defaultdict(set))

    def resistor(self, role: str, name: str, ends: tuple[str, str], ohms: float) -> None:
        """Place a resistor of the nearest value of the series."""
        part = boards.Resistor(name, *ends, preferred(ohms, self.series))
        self.resistors.append(part)
        self.roles[role].add(part.card)

    def capacitor(self, role: str, name: str, ends: tuple[str, str], farads: float) -> None:
        """Place a capacitor of this value."""
        part = boards.Capacitor(name, *ends, farads)
        self.capacitors.append(part)
        self.roles[role].add(part.card)

    def matrix(self, role: str, matrix: boards.ResistorMatrix) -> None:
        """Place a matrix of resistors."""
        self.matrices.append(matrix)
        self.roles[role].add(matrix.name)

    @contextmanager
    def stated(self, role: str) -> Iterator[None]:
        """State all parts that are placed inside as parts with `role`, strays too."""
        kinds: tuple[Sequence[boards.Part], ...] = (
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
        self.opamps.append(boards.OpAmpCell(name, self.model, GROUND, summing, output))
        self.stray_at(summing)

    def stage(self, name: str, plus: str, minus: str, output: str) -> None:
        """Place an op-amp whose inputs are summing nodes or ground, and their strays."""
        self.opamps.append(boards.OpAmpCell(name, self.model, plus, minus, output))
        for node in (plus, minus):
            if node != GROUND:
                self.stray_at(node)

    def follower(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain buffer from `source` to `output`."""
        self.opamps.append(boards.OpAmpCell(name, self.model, source, output, output))

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


@dataclass(slots=True)
class GrowingBoard:
    """A board while its topology places its parts; channels and sensors count from 1."""

    scene: Scene
    problem: InverseProblem
    facts: Mapping[str, Fact]
    model: OpAmp
    T: Floats = field(init=False)  # (M, N), after pruning
    parts: Parts = field(init=False)

    def __post_init__(self) -> None:
        design = self.scene.design
        self.T = pruned(self.problem.matrix, design.prune)
        own = design.stray_capacitance, design.inverter_resistance, design.resistor_series
        self.parts = Parts(self.model.name, *own)

    @property
    def channels(self) -> range:
        """The channels."""
        return range(1, self.T.shape[1] + 1)

    @property
    def sensors(self) -> list[int]:
        """The sensors whose rows of T have an entry."""
        return (1 + np.flatnonzero(self.T.any(axis=1))).tolist()

    def place_strain(self, k: int, sink: str) -> None:
        """Place the source of the strain of sensor `k`, in volts with a resistor 1/G0, and noise.

        Without strain the resistor ends at ground, so that the noise gain is that of the others.
        """
        parts, design, name = self.parts, self.scene.design, f"eps_{k}"
        strain, conductance = float(self.problem.strain[k - 1]), self.facts["G0"].value
        volts = strain * self.facts["U0"].value
        if design.strain_input == "voltage":
            node = f"e_{k}" if strain else GROUND
            parts.resistor(Role.STRAIN_RESISTOR, f"e_{k}", (node, sink), 1.0 / conductance)
            if strain:
                parts.voltages.append(boards.VoltageSource(name, node, volts, switched=True))
        elif strain:
            amps = strain * conductance * self.facts["U0"].value
            parts.currents.append(boards.CurrentSource(name, sink, amps))
        if design.sensor_noise > 0.0:
            parts.noises.append(boards.NoiseCurrent(name, sink, design.sensor_noise))

    def circuit(self, rows: str, own: Iterable[Omission], **stated: Any) -> Circuit:
        """Return the board; `rows`: letter of the sensors' outputs, `own`: what is left out."""
        kinds: dict[str, Any] = {kind: tuple(getattr(self.parts, kind)) for kind in KINDS}
        sensors = self.channels if rows == "v" else self.sensors
        return Circuit(
            name=self.scene.name,
            amplifier=self.scene.design.amplifier,
            topology=self.scene.design.topology,
            models={self.model.name: self.model},
            supply=self.scene.design.supply,
            roles={role: frozenset(names) for role, names in self.parts.roles.items()},
            signal_nodes=tuple(f"v_{n}" for n in self.channels),
            constraint_nodes=tuple(f"{rows}_{k}" for k in sensors),
            omissions=(*self._entries_left_out(), *own, *self._simplest_parts()),
            **{"facts": self.facts} | kinds | stated,
        )

    def _entries_left_out(self) -> Iterator[Omission]:
        """Yield what pruning, and zeros of T and of the strain, leave out on the board."""
        whole, strain = self.problem.matrix, self.problem.strain
        out = whole - self.T
        if count := int(np.count_nonzero(out)):
            largest = np.abs(out).max() / np.abs(whole).max()
            norm = np.linalg.norm(out) / np.linalg.norm(whole)
            yield Omission(
                f"{2 * count} pruned matrix resistors",
                f"{count} entries of T are below design.prune = {self.scene.design.prune:g} of the"
                f" largest entry, the largest of them at {largest:.3g}; their norm is {norm:.2g} of"
                " the norm of T",
            )
        if zeros := int(np.count_nonzero(whole == 0)):
            yield Omission(f"{2 * zeros} matrix resistors", f"{zeros} entries of T are zero")
        seen = self.T.any(axis=1)
        if rows := int(np.count_nonzero(~seen)):
            why = "their rows of T are all zeros: they would see no output"
            yield Omission(f"{rows} constraint nodes", why)
        if silent := int(np.count_nonzero((strain == 0) & seen)):
            yield Omission(
                f"{silent} strain {self.scene.design.strain_input}s", "their strain is zero"
            )

    def _simplest_parts(self) -> Iterator[Omission]:
        """Yield what the op-amps and the summing nodes do not have."""
        for figure, empty in ABSENT.items():
            if getattr(self.model, figure) == empty:
                what = {"gbw": "first pole"}.get(figure, spaced(figure))
                what = what.replace("differential", "differential input")
                yield Omission(f"op-amp {what}", f"{self.model.name}.{figure} is {empty:g}")
        if self.scene.design.stray_capacitance == 0:
            yield Omission("stray capacitors", "design.stray_capacitance is 0")


ABSENT = {"gbw": math.inf, "second_pole": math.inf, "input_resistance": math.inf,
          "differential_capacitance": 0.0, "input_capacitance": 0.0,
          "output_resistance": 0.0}  # fmt: skip
"""Figures of an op-amp that does not have them."""


def matrix_resistors(matrix: Floats, scene: Scene) -> tuple[Floats, Bools]:
    """Return ohms ``1 / (|T| G0)``, infinite for T = 0, and whether T is negative; both (M, N)."""
    with np.errstate(divide="ignore"):
        ohms = 1.0 / (np.abs(matrix) * scene.design.unit_conductance)
    return nearest(ohms, scene.design.resistor_series), matrix < 0


def pruned(matrix: Floats, fraction: float) -> Floats:
    """Return T (M, N) with zeros for entries below a `fraction` of the largest ``|T|``."""
    if fraction == 0.0:
        return matrix
    size = np.abs(matrix)
    return np.where(size < fraction * size.max(), 0.0, matrix)
