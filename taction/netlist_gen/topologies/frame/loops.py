"""The board that solves in one loop, and three ways to give its arrays negative entries.

==============  ============================  ===========================================
way             parts                         price
==============  ============================  ===========================================
inverters       an inverter for each driver   as many op-amps again, and their poles
                with a negative entry         stand in the loop
differential    negative entries end at the   resistors to ground that load both inputs
                other input of the op-amp     alike; the inputs are no virtual grounds
offset          one column, driven by one     an op-amp with the noise gain N + 1, and
                inverter of the sum           outputs that add up: its time grows with N
==============  ============================  ===========================================

All three rest at the same answer. The board has op-amps and arrays of conductances, no C and no s.

`Loop` is the frame of these topologies. Every op-amp has an array at one of its inputs; the other
input is on ground, or takes the negative entries. The arrays carry ``G0 T``, and the
sources are those of the other topologies, so an output has the voltage ``-u U0``. Stray capacitance
is at every input and output: an output drives a whole line of an array.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.built_arrays import as_programmed, device_of
from taction.netlist_gen.board.circuit import (
    GROUND,
    Circuit,
    Fact,
    Knob,
    Omission,
    Output,
    Role,
    common_facts,
)
from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.parts import ResistorMatrix
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.entries import (
    Numbered,
    Parts,
    matrix_resistors,
    omitted,
    pruned,
)
from taction.netlist_gen.topologies.frame.topology import Topology
from taction.system.array_types import Bools, Floats
from taction.system.errors import Complaint, InputError


@dataclass(frozen=True, slots=True, eq=False)
class Array:
    """An array of conductances with the signs of T."""

    role: str  # `Role.FORWARD`: columns drive and rows sum; else rows drive and columns sum
    name: str  # of its resistors in the deck
    T: Floats  # (M, N): the entries
    drives: tuple[str, ...]  # nodes of the drivers
    sinks: tuple[str, ...]  # the input of each op-amp that takes the array
    others: tuple[str, ...]  # its other input

    @property
    def by_column(self) -> bool:
        """Whether columns drive."""
        return self.role == Role.FORWARD

    def of_driver(self, place: int) -> Floats:
        """Return the entries of a driver, from 0."""
        return self.T[:, place] if self.by_column else self.T[place]


class Way(ABC):
    """How the entries of an array get their signs."""

    # whether negative entries end at the other input of an op-amp
    uses_other_input: ClassVar[bool] = False

    @abstractmethod
    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place the resistors of an array, and what its negative entries need."""

    def facts(self, T: Floats) -> dict[str, Fact]:
        """Return what a board with the matrix `T` states besides."""
        return {}


class Inverters(Way):
    """An inverter for each driver with a negative entry."""

    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place inverters and one matrix; see `Way`."""
        inverted = []
        for place, source in enumerate(array.drives):
            node = ""
            if source and np.any(array.of_driver(place) < 0.0):
                head, _, number = source.partition("_")
                node = f"{INVERSE[head]}_{number}"
                parts.inverting(node, source, node)
            inverted.append(node)
        ohms, negative = matrix_resistors(array.T, scene)
        _place(parts, array, array.name, ohms, negative, tuple(inverted))


class Differential(Way):
    """Negative entries at the other input of the op-amp."""

    uses_other_input = True

    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place a matrix for each sign; see `Way`."""
        ohms, negative = matrix_resistors(array.T, scene)
        _place(parts, array, array.name, np.where(negative, np.inf, ohms))
        if negative.any():
            below = np.where(negative, ohms, np.inf)
            _place(parts, array, f"{array.name}n", below, opposite=True)


class Offset(Way):
    """One more column: T less its least entry is positive."""

    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place the shifted matrix, an inverter of the sum, and the column; see `Way`."""
        below = _offset(array.T)
        ohms, _ = matrix_resistors(array.T + below, scene)
        _place(parts, array, array.name, ohms)
        if below == 0.0:
            return
        head = next(source for source in array.drives if source).partition("_")[0]
        output = f"sum_{head}"
        summing, inverter = f"j{output}", scene.design.inverter_resistance
        parts.opamp(output, summing, output)
        for source in filter(None, array.drives):
            parts.resistor(Role.SUM, f"{output}_{source}", (source, summing), inverter)
        parts.resistor(Role.SUM, f"{output}_fb", (output, summing), inverter)
        column = 1.0 / (below * scene.design.unit_conductance)
        for sink in filter(None, array.sinks):
            parts.resistor(Role.OFFSET, f"off_{sink}", (output, sink), column)

    def facts(self, T: Floats) -> dict[str, Fact]:
        """Return the offset; see `Way`."""
        below = _offset(T)
        if below == 0.0:
            return {}
        title, key = "offset of every entry of T", "design.negative_entries"
        return {"offset": Fact("offset", below, "", "b", title, key)}


def _offset(T: Floats) -> float:
    return max(0.0, -float(T.min()))


def _place(
    parts: Parts,
    array: Array,
    name: str,
    ohms: Floats,
    negative: Bools | None = None,
    minus: tuple[str, ...] = (),
    *,
    opposite: bool = False,
) -> None:
    """Place a matrix of resistors between the drivers and the inputs of an array."""
    signs: Bools = np.zeros(ohms.shape, dtype=np.bool_) if negative is None else negative
    inverted = minus or ("",) * len(array.drives)
    sinks = array.others if opposite else array.sinks
    ends = tuple(node or GROUND for node in sinks)
    parts.matrix(
        array.role,
        ResistorMatrix(name, ohms, signs, array.by_column, array.drives, inverted, ends, opposite),
    )


INVERSE = {"v": "a", "w": "z", "y": "q"}
"""The letter of the inverse of an output."""
WAYS: Mapping[str, Way] = {
    "inverters": Inverters(),
    "differential": Differential(),
    "offset": Offset(),
}
"""By the words of ``design.negative_entries``."""


SAME_LOAD = 1e-12  # relative difference of two loads that need no resistor


@dataclass(slots=True)
class Inputs:
    """The two inputs of an op-amp: `first` takes the array, `other` what has the other sign."""

    first: str
    other: str


@dataclass(slots=True)
class LoopBoard(Numbered):
    """A board of one loop while it is built."""

    scene: Scene
    facts: dict[str, Fact]
    T: Floats  # (M, N), after pruning
    strain: Floats  # (M,)
    parts: Parts
    way: Way
    stages: list[Inputs] = field(default_factory=list)

    @property
    def present(self) -> Bools:
        """Where T has an entry, (M, N)."""
        return np.asarray(self.T != 0.0)

    def inputs(self, first: str, other: str, entries: Floats) -> Inputs:
        """Return the inputs of an op-amp for its `entries` of T: the other one may be ground."""
        needed = self.way.uses_other_input and bool(np.any(entries < 0.0))
        stage = Inputs(first, other if needed else GROUND)
        self.stages.append(stage)
        return stage

    def first_stage(self, name: str, stage: Inputs, output: str) -> None:
        """Place an op-amp that turns the current into its input into ``-current / gf``."""
        self.parts.stage(name, stage.other, stage.first, output)
        role, ohms = Role.OUTPUT_CONDUCTANCE, 1.0 / self.facts["gf"].value
        self.parts.resistor(role, f"g_{output}", (output, stage.first), ohms)
        if stage.other != GROUND:
            self.parts.resistor(role, f"go_{output}", (stage.other, GROUND), ohms)

    def pad(self) -> None:
        """Load both inputs of every op-amp alike, by a resistor to ground at the lighter one.

        An array loads as its devices can be programmed. What compensates wires leaves its load as
        it would be without them.
        """
        device = device_of(self.scene)
        loads: defaultdict[str, float] = defaultdict(float)
        for part in self.parts.resistors:
            for node in (part.a, part.b):
                loads[node] += 1.0 / part.ohms
        for matrix in self.parts.matrices:
            ohms = as_programmed(matrix.ohms, device)
            siemens = np.sum(1.0 / ohms, axis=1 if matrix.by_column else 0)
            for node, load in zip(matrix.sinks, siemens.tolist(), strict=True):
                loads[node] += load
        for stage in self.stages:
            if stage.other == GROUND:
                continue
            light, heavy = sorted((stage.first, stage.other), key=loads.__getitem__)
            missing = loads[heavy] - loads[light]
            if missing > SAME_LOAD * loads[heavy]:
                ends = (light, GROUND)
                self.parts.resistor(Role.PADDING, f"pad_{light}", ends, 1.0 / missing)


class Loop(Topology):
    """A topology of one loop; its class says which op-amps there are.

    Attributes
    ----------
    has_first_stages : bool
        Whether the board has stages with the feedback conductance gf.
    regularised : bool
        Whether lambda stands in it.
    """

    has_first_stages: ClassVar[bool] = True
    regularised: ClassVar[bool] = False
    unused = frozenset(
        {"capacitance", "resistance", "gain", "capacitor_series", "exponential_slope", "antilog"}
    )

    searched = ("design.feedback_conductance", "design.unit_conductance")

    @abstractmethod
    def check(self, scene: Scene, T: Floats) -> None:
        """Raise InputError for a scene or a matrix (M, N) that the topology cannot be built for."""

    @abstractmethod
    def place(self, board: LoopBoard) -> None:
        """Place op-amps, strains and arrays."""

    @property
    def constraint_outputs(self) -> str:
        """The letter of the outputs that belong to the sensors."""
        return "w" if self.has_first_stages else "v"

    def facts(self, scene: Scene) -> dict[str, Fact]:
        """Return G0, U0, lambda and gf; see `Topology`."""
        design = scene.design
        gf = design.feedback_conductance or design.unit_conductance
        numbers = {
            "G0": design.unit_conductance,
            "U0": design.unit_voltage,
            "lambda": self._lambda(scene),
        }
        return common_facts(**numbers, **({"gf": gf} if self.has_first_stages else {}))

    def knobs(self, scene: Scene) -> tuple[Knob, ...]:
        """Return gf, G0 and U0 as the keys that can be moved."""
        key, U0 = "design.unit_conductance", Knob("U0", "design.unit_voltage")
        if not self.has_first_stages:
            G0 = Knob("G0", key, Role.UNIT, margin="smaller", words="G0", power=-1.0)
            return G0, U0
        return (
            Knob(
                "gf",
                "design.feedback_conductance",
                Role.OUTPUT_CONDUCTANCE,
                margin="smaller",
                words="gf",
                power=-1.0,
            ),
            Knob("G0", key),
            U0,
        )

    def synthesise(self, scene: Scene, problem: InverseProblem) -> Circuit:
        """Design the board of `scene` for `problem`; see `Topology`."""
        design, facts, model = scene.design, self.facts(scene), choose_opamp(scene)
        if design.amplifier != "linear":
            text = f"topology {self.name!r} has no signal amplifiers; expected 'linear'"
            complaint = Complaint("design.amplifier", repr(design.amplifier), text)
            raise InputError(scene.file, complaint)
        T = pruned(problem.matrix, design.prune)
        self.check(scene, T)
        inverter, series = design.inverter_resistance, design.resistor_series
        parts = Parts(model.name, design.stray_capacitance, inverter, series)
        way = WAYS[design.negative_entries]
        board = LoopBoard(scene, facts, T, problem.strain, parts, way)
        self.place(board)
        board.pad()
        for cell in parts.opamps:  # it drives a whole line of an array
            parts.stray_at(cell.output)
        rows = board.sensors if self.has_first_stages else board.channels
        others = parts.roles[Role.INVERTER_RESISTOR] | parts.roles[Role.SUM]
        resistors = {part.card for part in parts.resistors} - others
        parts.roles[Role.UNIT] = resistors | {matrix.name for matrix in parts.matrices}
        return parts.circuit(
            scene,
            model,
            topology=self.name,
            facts={**facts, **way.facts(T)},
            signal_nodes=tuple(f"v_{n}" for n in board.channels),
            constraint_nodes=tuple(f"{self.constraint_outputs}_{k}" for k in rows),
            outputs=tuple(Output(f"v_{n}", -1.0) for n in board.channels),
            omissions=omitted(scene, problem, T, model, self._omissions(T)),
            knobs=self.knobs(scene),
        )

    def array(
        self, board: LoopBoard, role: str, drives: Mapping[int, str], stages: Mapping[int, Inputs]
    ) -> None:
        """Place an array: the matrix of the role between `drives` and the inputs of `stages`."""
        by_column = role == Role.FORWARD
        M, N = board.T.shape
        across, down = (N, M) if by_column else (M, N)
        nothing = Inputs("", "")
        ends = [stages.get(k, nothing) for k in range(1, down + 1)]
        sources = tuple(drives.get(n, "") for n in range(1, across + 1))
        sinks = tuple(e.first for e in ends), tuple(e.other for e in ends)
        name = "Rf" if by_column else "Rb"
        board.way.connect(board.parts, board.scene, Array(role, name, board.T, sources, *sinks))

    def _lambda(self, scene: Scene) -> float:
        lam = scene.design.lam
        if self.regularised:
            if isinstance(lam, int | float):
                return float(lam)
            text = (
                f"topology {self.name!r} needs a number above zero, or the name of a rule:"
                " its resistors follow from lambda"
            )
            raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
        if lam is not None:
            text = f"topology {self.name!r} has no regularisation; expected no lambda, or 'ridge'"
            raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
        return 0.0

    def _omissions(self, kept: Floats) -> Iterator[Omission]:
        """Yield the parts that are omitted; `kept` (M, N) is T after pruning."""
        why = f"topology {self.name!r} settles at the speed of its op-amps"
        yield Omission("signal capacitors and constraint gain", why)
        if not np.any(kept < 0.0):
            yield Omission("parts for negative entries", "no entry of T is negative")
