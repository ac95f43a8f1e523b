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

from abc import abstractmethod
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

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
from taction.netlist_gen.board.parts import OpAmpCell, Resistor, ResistorMatrix
from taction.netlist_gen.board.synthesis import as_programmed, device_of
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import GrowingBoard, Topology, matrix_resistors
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError

SAME_LOAD = 1e-12  # relative difference of two loads that need no resistor
INVERSE = {"v": "a", "w": "z", "y": "q"}  # letter of the inverse of an output


@dataclass(slots=True)
class Inputs:
    """The two inputs of an op-amp: `first` takes the array, `other` what has the other sign."""

    first: str
    other: str


@dataclass(slots=True)
class LoopBoard(GrowingBoard):
    """A board of one loop while it is built."""

    stages: list[Inputs] = field(default_factory=list)

    @property
    def way(self) -> str:
        """How its arrays get negative entries."""
        return self.scene.design.negative_entries

    @property
    def offset(self) -> float:
        """What is added to every entry of T, which is then not negative."""
        return max(0.0, -float(self.T.min())) if self.way == "offset" else 0.0

    def inputs(self, first: str, other: str, entries: Floats) -> Inputs:
        """Return the inputs of an op-amp for its `entries` of T: the other one may be ground."""
        needed = self.way == "differential" and bool(np.any(entries < 0.0))
        stage = Inputs(first, other if needed else GROUND)
        self.stages.append(stage)
        return stage

    def first_stage(self, name: str, stage: Inputs, output: str) -> None:
        """Place an op-amp that turns the current into its input into ``-current / gf``."""
        self.opamp(name, stage.first, output, stage.other)
        role, ohms = Role.OUTPUT_CONDUCTANCE, 1.0 / self.facts["gf"].value
        self.resistor(role, f"g_{output}", (output, stage.first), ohms)
        if stage.other != GROUND:
            self.resistor(role, f"go_{output}", (stage.other, GROUND), ohms)

    def array(self, role: str, drives: Mapping[int, str], stages: Mapping[int, Inputs]) -> None:
        """Place the matrix of a role between `drives` and the inputs of `stages`.

        Columns of T drive the matrix `Role.FORWARD`, rows the other one.
        """
        by_column = role == Role.FORWARD
        name, lines = ("Rf", self.T.T) if by_column else ("Rb", self.T)
        across, down = lines.shape
        sources = tuple(drives.get(n, "") for n in range(1, across + 1))
        ends = [stages.get(k, Inputs(GROUND, GROUND)) for k in range(1, down + 1)]
        sinks, others = tuple(each.first for each in ends), tuple(each.other for each in ends)
        inverted, below = ("",) * across, self.offset
        ohms, negative = matrix_resistors(self.T + below, self.scene)
        if self.way == "inverters":
            inverted = tuple(map(self._inverse, sources, lines))
        minus = np.where(negative, ohms, np.inf)
        if self.way == "differential":
            ohms, negative = np.where(negative, np.inf, ohms), np.zeros_like(negative)
        fixed = by_column, sources, inverted
        self.place(ResistorMatrix(name, ohms, negative, *fixed, sinks), role)
        if self.way == "differential" and np.isfinite(minus).any():
            below_zero = ResistorMatrix(f"{name}n", minus, negative, *fixed, others, opposite=True)
            self.place(below_zero, role)
        if below:
            self._offset_column([*filter(None, sources)], [*filter(None, stages.values())], below)

    def _inverse(self, source: str, entries: Floats) -> str:
        """Place the inverter of a driver with a negative entry; return its output, if any."""
        if not (source and np.any(entries < 0.0)):
            return ""
        head, _, number = source.partition("_")
        node = f"{INVERSE[head]}_{number}"
        self.inverting(node, source, node)
        return node

    def _offset_column(self, sources: list[str], stages: list[Inputs], below: float) -> None:
        """Place an inverter of the sum of all drivers, and the column that it drives."""
        output = f"sum_{sources[0].partition('_')[0]}"
        summing, inverter = f"j{output}", self.scene.design.inverter_resistance
        self.opamp(output, summing, output)
        for source in sources:
            self.resistor(Role.SUM, f"{output}_{source}", (source, summing), inverter)
        self.resistor(Role.SUM, f"{output}_fb", (output, summing), inverter)
        ohms = 1.0 / (below * self.scene.design.unit_conductance)
        for stage in stages:
            self.resistor(Role.OFFSET, f"off_{stage.first}", (output, stage.first), ohms)

    def pad(self) -> None:
        """Load both inputs of every op-amp alike, by a resistor to ground at the lighter one.

        An array loads as its devices can be programmed. What compensates wires leaves its load as
        it would be without them.
        """
        device = device_of(self.scene)
        loads: defaultdict[str, float] = defaultdict(float)
        for part in self.of(Resistor):
            for node in (part.a, part.b):
                loads[node] += 1.0 / part.ohms
        for matrix in self.of(ResistorMatrix):
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
                self.resistor(Role.PADDING, f"pad_{light}", ends, 1.0 / missing)


class Loop(Topology):
    """A topology of one loop; its class says which op-amps there are."""

    has_first_stages: ClassVar[bool] = True  # with the feedback conductance gf
    regularised: ClassVar[bool] = False  # whether lambda stands in it
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
        role = Role.OUTPUT_CONDUCTANCE
        gf = Knob("gf", "design.feedback_conductance", role, {}, "smaller", "gf", power=-1.0)
        return gf, Knob("G0", key), U0

    def synthesise(self, scene: Scene, problem: InverseProblem) -> Circuit:
        """Design the board of `scene` for `problem`; see `Topology`."""
        design, facts, model = scene.design, self.facts(scene), choose_opamp(scene)
        if design.amplifier != "linear":
            text = f"topology {self.name!r} has no signal amplifiers; expected 'linear'"
            complaint = Complaint("design.amplifier", repr(design.amplifier), text)
            raise InputError(scene.file, complaint)
        board = LoopBoard(scene, problem, facts, model)
        self.check(scene, board.T)
        self.place(board)
        board.pad()
        for cell in board.of(OpAmpCell):  # it drives a whole line of an array
            board.stray_at(cell.output)
        others = board.roles[Role.INVERTER_RESISTOR] | board.roles[Role.SUM]
        resistors = {part.card for part in board.of(Resistor)} - others
        board.roles[Role.UNIT] = resistors | {matrix.name for matrix in board.of(ResistorMatrix)}
        if board.offset:
            title, key = "offset of every entry of T", "design.negative_entries"
            facts["offset"] = Fact("offset", board.offset, "", "b", title, key)
        return board.circuit(
            "w" if self.has_first_stages else "v",
            self._omissions(board.T),
            outputs=tuple(Output(f"v_{n}", -1.0) for n in board.channels),
            knobs=self.knobs(scene),
        )

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
