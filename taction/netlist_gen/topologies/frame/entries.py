"""What every topology does with the entries of T and the strain: the parts it collects."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
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


class Numbered(ABC):
    """The numbers of channels and sensors of a board while it is built, from 1."""

    __slots__ = ()

    @property
    @abstractmethod
    def present(self) -> Bools:
        """Where T has an entry, (M, N)."""

    @property
    def channels(self) -> range:
        """The channels."""
        return range(1, self.present.shape[1] + 1)

    @property
    def sensors(self) -> list[int]:
        """The sensors whose rows of T have an entry."""
        return (1 + np.flatnonzero(self.present.any(axis=1))).tolist()


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


def omitted(
    scene: Scene, problem: InverseProblem, kept: Floats, model: OpAmp, own: Iterable[Omission]
) -> tuple[Omission, ...]:
    """Return what a board omits, its `own` parts among it; `kept` (M, N) is T after pruning."""
    left = _left_out_of_the_matrix(problem, kept, scene.design.strain_input)
    pruning = _pruning(problem.matrix, scene.design.prune)
    return (*pruning, *left, *own, *_simplest_parts(model, scene))


def _pruning(matrix: Floats, fraction: float) -> Iterator[Omission]:
    """Yield what `pruned` takes out of both resistor matrices."""
    out = matrix - pruned(matrix, fraction)
    count = int(np.count_nonzero(out))
    if not count:
        return
    largest = np.abs(out).max() / np.abs(matrix).max()
    norm = np.linalg.norm(out) / np.linalg.norm(matrix)
    why = (
        f"{count} entries of T are below design.prune = {fraction:g} of the largest entry, the"
        f" largest of them at {largest:.3g}; their norm is {norm:.2g} of the norm of T"
    )
    yield Omission(f"{2 * count} pruned matrix resistors", why)


def place_strain(
    parts: Parts, scene: Scene, facts: Mapping[str, Fact], k: int, sink: str, strain: float
) -> None:
    """Place the source of the strain of sensor `k`, in volts with a resistor 1/G0, and its noise.

    Without strain the resistor ends at ground, so that the noise gain is that of the others.
    """
    design, name = scene.design, f"eps_{k}"
    conductance, unit = facts["G0"].value, facts["U0"].value
    if design.strain_input == "voltage":
        node = f"e_{k}" if strain else GROUND
        parts.resistor(Role.STRAIN_RESISTOR, f"e_{k}", (node, sink), 1.0 / conductance)
        if strain:
            parts.voltages.append(boards.VoltageSource(name, node, strain * unit, switched=True))
    elif strain:
        parts.currents.append(boards.CurrentSource(name, sink, strain * conductance * unit))
    if design.sensor_noise > 0.0:
        parts.noises.append(boards.NoiseCurrent(name, sink, design.sensor_noise))


def _left_out_of_the_matrix(
    problem: InverseProblem, T: Floats, strain_input: str
) -> Iterator[Omission]:
    """Yield what the entries of `T` (M, N), after pruning, leave out on the board."""
    zeros = int(np.count_nonzero(problem.matrix == 0))
    if zeros:
        yield Omission(f"{2 * zeros} matrix resistors", f"{zeros} entries of T are zero")
    rows = int(np.count_nonzero(~T.any(axis=1)))
    if rows:
        why = "their rows of T are all zeros: they would see no output"
        yield Omission(f"{rows} constraint nodes", why)
    silent = int(np.count_nonzero((problem.strain == 0) & T.any(axis=1)))
    if silent:
        yield Omission(f"{silent} strain {strain_input}s", "their strain is zero")


def _simplest_parts(model: OpAmp, scene: Scene) -> Iterator[Omission]:
    """Yield what the op-amps and the summing nodes of a scene do not have."""
    figures = (
        ("first pole", "gbw", math.inf),
        ("second pole", "second_pole", math.inf),
        ("input resistance", "input_resistance", math.inf),
        ("differential input capacitance", "differential_capacitance", 0.0),
        ("input capacitance", "input_capacitance", 0.0),
        ("output resistance", "output_resistance", 0.0),
    )
    for what, figure, empty in figures:
        if getattr(model, figure) == empty:
            yield Omission(f"op-amp {what}", f"{model.name}.{figure} is {empty:g}")
    if scene.design.stray_capacitance == 0:
        yield Omission("stray capacitors", "design.stray_capacitance is 0")
