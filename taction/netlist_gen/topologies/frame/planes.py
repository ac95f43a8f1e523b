"""The board of two planes: signal nodes with amplifiers, constraint nodes, two matrices.

`Planes` is the frame of the topologies that differ in their signal nodes alone. It has only the
parts that the scene needs; `Circuit.omissions` has the others.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Fact, Omission, Output, Role
from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.parts import ResistorMatrix, SignalAmplifier
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.antilog import AntilogStage
from taction.netlist_gen.topologies.frame.entries import (
    Numbered,
    Parts,
    matrix_resistors,
    omitted,
    place_strain,
    pruned,
)
from taction.netlist_gen.topologies.frame.topology import Topology, slope_of
from taction.system.array_types import Bools, Floats


@dataclass(slots=True)
class PlanesBoard(Numbered):
    """A board of two planes while it is built."""

    scene: Scene
    facts: Mapping[str, Fact]
    ohms: Floats  # (M, N) of both matrices, infinite where T is zero
    negative: Bools  # (M, N): where T is negative
    parts: Parts
    stage: AntilogStage | None
    outputs: list[Output] = field(default_factory=list)
    plus_u: dict[int, str] = field(default_factory=dict)  # nodes of +u, where there is one

    @property
    def present(self) -> Bools:
        """Where T has an entry, (M, N)."""
        return np.isfinite(self.ohms)

    @property
    def ridge_ohms(self) -> float:
        """The resistor that removes a share of the ridge term, ohm; infinite where all stays."""
        design, share = self.scene.design, 1.0 - self.scene.design.ridge_share
        ohms = self.facts["R"].value * design.unit_voltage / slope_of(self.scene)
        return ohms / share if share else math.inf


class Planes(Topology):
    """A topology of two planes; its class says what a signal node is.

    Attributes
    ----------
    feedback_inverts : bool
        Whether a positive current into the node that `signal_node` returns makes v negative.
    """

    feedback_inverts: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        """Raise InputError for a scene that the topology cannot be built for."""

    @abstractmethod
    def signal_node(self, board: PlanesBoard, n: int) -> str:
        """Place the parts of signal node ``v_n``; return the node that takes the feedback."""

    def linear_output(self, board: PlanesBoard, n: int) -> str:
        """Place what drives the matrix in a linear channel; return its output, +u_n."""
        return f"v_{n}"

    def synthesise(self, scene: Scene, problem: InverseProblem) -> Circuit:
        """Design the board of `scene` for `problem`; see `Topology`."""
        design, facts = scene.design, self.facts(scene)
        model = choose_opamp(scene)
        kept = pruned(problem.matrix, design.prune)
        ohms, negative = matrix_resistors(kept, scene)
        inverter, series = design.inverter_resistance, design.resistor_series
        parts = Parts(model.name, design.stray_capacitance, inverter, series)
        self.check(scene)
        stage = AntilogStage.of(scene, model) if design.antilog.has_devices else None
        board = PlanesBoard(scene, facts, ohms, negative, parts, stage)
        sinks = self._signal_plane(board)
        self._constraint_plane(board, problem.strain)
        self._connect(board, sinks)
        return parts.circuit(
            scene,
            model,
            topology=self.name,
            facts=facts,
            signal_nodes=tuple(f"v_{n}" for n in board.channels),
            constraint_nodes=tuple(f"w_{k}" for k in board.sensors),
            outputs=tuple(board.outputs),
            omissions=omitted(scene, problem, kept, model, self._omissions(scene, kept)),
            transistor_models={} if stage is None else {stage.pair.name: stage.pair},
            temperature=design.antilog.temperature,
            knobs=self.knobs(scene),
        )

    def _signal_plane(self, board: PlanesBoard) -> tuple[str, ...]:
        """Place signal nodes, their amplifiers and the bias; return the nodes of the feedback."""
        needs_minus = np.any(board.present & ~board.negative, axis=0).tolist()
        needs_plus = np.any(board.present & board.negative, axis=0).tolist()
        sinks = []
        for n in board.channels:
            sinks.append(self.signal_node(board, n))
            plus = needs_plus[n - 1] or (board.ridge_ohms < math.inf and not self.feedback_inverts)
            self._amplifier(board, n, minus=needs_minus[n - 1], plus=plus)
            self._remove_ridge(board, n, sinks[-1])
        return tuple(sinks)

    def _remove_ridge(self, board: PlanesBoard, n: int, sink: str) -> None:
        """Place the resistor that adds a share of ``u Ve/(R U0)`` to the current of channel `n`."""
        if board.ridge_ohms < math.inf:
            source = f"a_{n}" if self.feedback_inverts else board.plus_u[n]
            ends = source, sink
            board.parts.resistor(Role.RIDGE_RESISTOR, f"ridge_{n}", ends, board.ridge_ohms)

    def _amplifier(self, board: PlanesBoard, n: int, *, minus: bool, plus: bool) -> None:
        """Place the signal amplifier of channel `n`, with an inverter where both signs are used."""
        design, parts = board.scene.design, board.parts
        if design.amplifier == "linear":
            output, inverts = self.linear_output(board, n), False
        elif board.stage is None:
            output, inverts = f"a_{n}", True
            scales = design.unit_voltage, slope_of(board.scene)
            parts.amplifiers.append(
                SignalAmplifier(output, design.amplifier, f"v_{n}", output, *scales)
            )
        else:
            output, inverts = board.stage.place(parts, n), board.stage.pair.polarity != "npn"
        board.outputs.append(Output(output, -1.0 if inverts else 1.0))
        if not inverts:
            board.plus_u[n] = output
        if plus if inverts else minus:
            other = f"u_{n}" if inverts else f"a_{n}"
            parts.inverting(other, output, other)
            if inverts:
                board.plus_u[n] = other

    def _constraint_plane(self, board: PlanesBoard, strain: Floats) -> None:
        """Place constraint nodes, the sources of `strain` (M,) and inverters of w."""
        parts, design = board.parts, board.scene.design
        inverted = board.negative if self.feedback_inverts else ~board.negative
        needs_inverter = np.any(board.present & inverted, axis=1).tolist()
        for k in board.sensors:
            parts.opamp(f"c_{k}", f"c_{k}", f"w_{k}")
            ends = f"w_{k}", f"c_{k}"
            parts.resistor(Role.CONSTRAINT_RESISTOR, f"s_{k}", ends, design.gain)
            place_strain(parts, board.scene, board.facts, k, f"c_{k}", float(strain[k - 1]))
            if needs_inverter[k - 1]:
                parts.inverting(f"z_{k}", f"w_{k}", f"z_{k}")

    def _connect(self, board: PlanesBoard, sinks: tuple[str, ...]) -> None:
        """Place both resistor matrices; the feedback ends at `sinks`, one node a channel."""
        rows = range(1, board.ohms.shape[0] + 1)
        minus_u = tuple(f"a_{n}" for n in board.channels)
        plus_u = tuple(board.plus_u.get(n, "") for n in board.channels)
        w, z = tuple(f"w_{k}" for k in rows), tuple(f"z_{k}" for k in rows)
        sums = tuple(f"c_{k}" for k in rows)
        plus, minus = (w, z) if self.feedback_inverts else (z, w)
        entries = board.ohms, board.negative
        board.parts.matrix(
            Role.FORWARD, ResistorMatrix("Rf", *entries, True, minus_u, plus_u, sums)
        )
        board.parts.matrix(Role.FEEDBACK, ResistorMatrix("Rb", *entries, False, plus, minus, sinks))

    def _omissions(self, scene: Scene, kept: Floats) -> Iterator[Omission]:
        """Yield the inverters and stages that are omitted; `kept` (M, N) is T after pruning."""
        linear = scene.design.amplifier == "linear"
        yield from _inverters("u", "columns", kept.T, "positive" if linear else "negative")
        rows = kept[kept.any(axis=1)]
        yield from _inverters(
            "w", "rows", rows, "negative" if self.feedback_inverts else "positive"
        )
        if linear:
            why = "linear amplifiers: the regulariser is the sum of squares"
            yield Omission("antilog stages and bias current", why)
        elif not scene.design.biased:
            yield Omission("bias current", "design.bias is false, or the amplifier needs none")


def _inverters(signal: str, lines: str, entries: Floats, sign: str) -> Iterator[Omission]:
    """Yield how many `lines` of T need no inverter: none of their `entries` (P, Q) has the sign."""
    signed = entries > 0 if sign == "positive" else entries < 0
    count = int(np.count_nonzero(~signed.any(axis=1)))
    if count:
        yield Omission(f"{count} inverters of {signal}", f"their {lines} have no {sign} entry")
