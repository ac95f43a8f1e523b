"""`Topology`: how a scene becomes a board, and what the board states about itself; their table.

The table has one module each beside this folder, and those of other packages. `GrowingBoard` is
what every topology does with the entries of T and the strain: the parts that it collects.

Other packages add a topology by an entry point of the group ``taction.topologies``: its name is
the word in the scene, its object a `Topology`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, ClassVar, TypeVar

import numpy as np

from taction.netlist_gen import topologies
from taction.netlist_gen.board import circuit as circuits
from taction.netlist_gen.board import parts as boards
from taction.netlist_gen.board.bill_of_materials import nearest, preferred
from taction.netlist_gen.board.circuit import GROUND, Circuit, Fact, Knob, Omission, Role
from taction.netlist_gen.scene.fields import LARGE, LEAST, MOST, SMALL, Model
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Bools, Floats
from taction.system.errors import Complaint, InputError
from taction.system.plugins import OpenTable
from taction.system.quantities import spaced


class Topology(ABC):
    """One way to build the network of a scene from parts.

    The facts and knobs here are those of a network in which lambda follows from R, the gain, G0
    and, if its amplifiers are not linear, from U0 and Ve. A topology may add its own.
    """

    name: ClassVar[str]  # the word in the scene
    keys: ClassVar[type[Model] | None] = None  # of its own table ``[design.NAME]``, if any
    # keys of ``[design]`` that have no effect on its boards
    unused: ClassVar[frozenset[str]] = frozenset({"feedback_conductance", "negative_entries"})
    # the two keys that a choice among designs moves
    searched: ClassVar[tuple[str, str]] = ("design.capacitance", "design.gain")
    exact: ClassVar[bool] = False  # whether a board rests at the solution of ``T u = eps``

    @abstractmethod
    def synthesise(self, scene: Scene, problem: InverseProblem) -> Circuit:
        """Design the board of `scene` for `problem`, with its roles, facts and knobs.

        Raises
        ------
        InputError
            The scene asks for what the topology does not have.
        """

    def facts(self, scene: Scene) -> dict[str, Fact]:
        """Return the numbers of the design by name, with R from lambda, or lambda from R.

        ``lam = 1 / (R s G0²)`` for linear amplifiers (eq (21) corrected) and
        ``lam = 2 Ve / (R s G0² U0)`` for exponential ones (eqs (16) and (8) in the board's units).

        Raises
        ------
        InputError
            R or lambda would not be a finite positive number.
        """
        design, slope = scene.design, slope_of(scene)
        linear = design.amplifier == "linear"
        scale = design.gain * design.unit_conductance**2
        product = 1.0 / scale if scale else np.inf
        if not linear:
            product *= 2.0 * slope / design.unit_voltage
        if isinstance(design.lam, str):
            text = (
                "expected a number; taction.verification.reference.lambda_rule finds it by a rule"
            )
            raise InputError(scene.file, Complaint("design.lambda", repr(design.lam), text))
        given = design.lam or design.resistance or DEFAULT_RESISTANCE
        other = product / given
        resistance, lam = (other, given) if design.lam is not None else (given, other)
        if not (LEAST <= resistance <= MOST and SMALL <= lam <= LARGE):
            text = (
                f"gain and unit_conductance give lambda times R = {product!r}, so R ="
                f" {resistance:g} ohm and lambda = {lam:g}: out of range; expected R between"
                f" {LEAST:g} and {MOST:g} ohm, lambda between {SMALL:g} and {LARGE:g}"
            )
            raise InputError(scene.file, Complaint("design", repr(given), text))
        numbers = {
            "G0": design.unit_conductance,
            "U0": design.unit_voltage,
            "R": resistance,
            "C": float(nearest(np.array([design.capacitance]), design.capacitor_series)[0]),
            "gain": design.gain,
            "lambda": lam,
        }
        return circuits.common_facts(**numbers, **({} if linear else {"Ve": slope}))

    def knobs(self, scene: Scene) -> tuple[Knob, ...]:
        """Return the keys of `scene` that can be moved, with the parts that they scale."""
        return circuits.common_knobs(linear=scene.design.amplifier == "linear")


def slope_of(scene: Scene) -> float:
    """Return Ve of a scene, V; 1 V, without effect, where it has none."""
    return scene.design.exponential_slope or 1.0


TOPOLOGIES: Mapping[str, Topology] = OpenTable(
    "taction.topologies",
    lambda: {n: import_module(f"{topologies.__name__}.{n}").TOPOLOGY for n in topologies.NAMES},
    Topology,
)
"""The topologies by the word in a scene."""


def topology_of(scene: Scene) -> Topology:
    """Return the topology of a scene."""
    return TOPOLOGIES[scene.design.topology]


P = TypeVar("P")


@dataclass(slots=True)
class GrowingBoard:
    """A board while its topology places its parts; channels and sensors count from 1."""

    scene: Scene
    problem: InverseProblem
    facts: Mapping[str, Fact]
    model: OpAmp
    T: Floats = field(init=False)  # (M, N), after pruning
    # parts in the order in which they were placed, and their names by role
    placed: list[Any] = field(default_factory=list, init=False)
    roles: defaultdict[str, set[str]] = field(default_factory=lambda: defaultdict(set), init=False)

    def __post_init__(self) -> None:
        self.T = pruned(self.problem.matrix, self.scene.design.prune)

    @property
    def channels(self) -> range:
        """The channels."""
        return range(1, self.T.shape[1] + 1)

    @property
    def sensors(self) -> list[int]:
        """The sensors whose rows of T have an entry."""
        return (1 + np.flatnonzero(self.T.any(axis=1))).tolist()

    def of(self, kind: type[P]) -> tuple[P, ...]:
        """Return the parts of a class."""
        return tuple(part for part in self.placed if type(part) is kind)

    def place(self, part: boards.Part | boards.ResistorMatrix, *roles: str) -> None:
        """Place a part, which has some roles."""
        self.placed.append(part)
        for role in filter(None, roles):
            self.roles[role].add(getattr(part, "card", part.name))

    def resistor(self, role: str, name: str, ends: tuple[str, str], ohms: float) -> None:
        """Place a resistor of the nearest value of the series."""
        self.place(
            boards.Resistor(name, *ends, preferred(ohms, self.scene.design.resistor_series)), role
        )

    def capacitor(self, role: str, name: str, ends: tuple[str, str], farads: float) -> None:
        """Place a capacitor of this value."""
        self.place(boards.Capacitor(name, *ends, farads), role)

    def opamp(
        self, name: str, inverting: str, output: str, noninverting: str = GROUND, role: str = ""
    ) -> None:
        """Place an op-amp whose inputs are summing nodes or ground, and their strays."""
        self.place(boards.OpAmpCell(name, self.model.name, noninverting, inverting, output), role)
        for node in (noninverting, inverting):
            if node != GROUND:
                self.stray_at(node, role)

    def follower(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain buffer from `source` to `output`."""
        self.place(boards.OpAmpCell(name, self.model.name, source, output, output))

    def stray_at(self, node: str, role: str = "") -> None:
        """Place the stray capacitance of a summing node."""
        farads = self.scene.design.stray_capacitance
        if farads > 0:
            stray = boards.Capacitor(f"stray_{node}", node, GROUND, farads)
            self.place(stray, Role.STRAY, role)

    def inverting(self, name: str, source: str, output: str) -> None:
        """Place a unity-gain inverter from `source` to `output` with the summing node j`output`."""
        summing, ohms = f"j{output}", self.scene.design.inverter_resistance
        self.opamp(name, summing, output)
        for end, node in (("in", source), ("fb", output)):
            self.resistor(Role.INVERTER_RESISTOR, f"{name}_{end}", (node, summing), ohms)

    def place_strain(self, k: int, sink: str) -> None:
        """Place the source of the strain of sensor `k`, in volts with a resistor 1/G0, and noise.

        Without strain the resistor ends at ground, so that the noise gain is that of the others.
        """
        design, name = self.scene.design, f"eps_{k}"
        strain, conductance = float(self.problem.strain[k - 1]), self.facts["G0"].value
        volts = strain * self.facts["U0"].value
        if design.strain_input == "voltage":
            node = f"e_{k}" if strain else GROUND
            self.resistor(Role.STRAIN_RESISTOR, f"e_{k}", (node, sink), 1.0 / conductance)
            if strain:
                self.place(boards.VoltageSource(name, node, volts, switched=True))
        elif strain:
            amps = strain * conductance * self.facts["U0"].value
            self.place(boards.CurrentSource(name, sink, amps))
        if design.sensor_noise > 0.0:
            self.place(boards.NoiseCurrent(name, sink, design.sensor_noise))

    def circuit(self, rows: str, own: Iterable[Omission], **stated: Any) -> Circuit:
        """Return the board; `rows`: letter of the sensors' outputs, `own`: what is left out."""
        kinds: dict[str, Any] = {field: self.of(kind) for kind, field in boards.PLACES.items()}
        sensors = self.channels if rows == "v" else self.sensors
        return Circuit(
            name=self.scene.name,
            amplifier=self.scene.design.amplifier,
            topology=self.scene.design.topology,
            models={self.model.name: self.model},
            supply=self.scene.design.supply,
            roles={role: frozenset(names) for role, names in self.roles.items()},
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
