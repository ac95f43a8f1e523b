"""The board of two planes: signal nodes with amplifiers, constraint nodes, two matrices.

`Planes` is the frame of the topologies that differ in their signal nodes alone. It has only the
parts that the scene needs; `Circuit.omissions` has the others.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Omission, Output, Role
from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.parts import ResistorMatrix, SignalAmplifier
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.antilog import AntilogStage
from taction.netlist_gen.topologies.frame.entries import GrowingBoard, matrix_resistors
from taction.netlist_gen.topologies.frame.topology import Topology, slope_of
from taction.system.array_types import Floats


@dataclass(slots=True)
class PlanesBoard(GrowingBoard):
    """A board of two planes while it is built."""

    stage: AntilogStage | None
    outputs: list[Output] = field(default_factory=list)
    plus_u: dict[int, str] = field(default_factory=dict)  # nodes of +u, where there is one

    @property
    def ridge_ohms(self) -> float:
        """The resistor that removes a share of the ridge term, ohm; infinite where all stays."""
        design, share = self.scene.design, 1.0 - self.scene.design.ridge_share
        ohms = self.facts["R"].value * design.unit_voltage / slope_of(self.scene)
        return ohms / share if share else math.inf


class Planes(Topology):
    """A topology of two planes; its class says what a signal node is."""

    # whether a positive current into the node that `signal_node` returns makes v negative
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
        facts, model, antilog = self.facts(scene), choose_opamp(scene), scene.design.antilog
        self.check(scene)
        stage = AntilogStage.of(scene, model) if antilog.has_devices else None
        board = PlanesBoard(scene, problem, facts, model, stage)
        sinks = self._signal_plane(board)
        self._constraint_plane(board)
        self._connect(board, sinks)
        return board.circuit(
            "w",
            self._omissions(board),
            outputs=tuple(board.outputs),
            transistor_models={} if stage is None else {stage.pair.name: stage.pair},
            temperature=antilog.temperature,
            knobs=self.knobs(scene),
        )

    def _signal_plane(self, board: PlanesBoard) -> tuple[str, ...]:
        """Place signal nodes, their amplifiers and the bias; return the nodes of the feedback."""
        ridge, sinks = board.ridge_ohms, []
        for n, column in zip(board.channels, board.T.T, strict=True):
            sinks.append(self.signal_node(board, n))
            plus = bool((column < 0.0).any()) or (ridge < math.inf and not self.feedback_inverts)
            self._amplifier(board, n, minus=bool((column > 0.0).any()), plus=plus)
            if ridge < math.inf:  # a share of ``u Ve/(R U0)`` in the current of the channel
                source = f"a_{n}" if self.feedback_inverts else board.plus_u[n]
                board.parts.resistor(Role.RIDGE_RESISTOR, f"ridge_{n}", (source, sinks[-1]), ridge)
        return tuple(sinks)

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

    def _constraint_plane(self, board: PlanesBoard) -> None:
        """Place constraint nodes, the sources of the strain and inverters of w."""
        parts, gain = board.parts, board.scene.design.gain
        for k in board.sensors:
            parts.opamp(f"c_{k}", f"c_{k}", f"w_{k}")
            parts.resistor(Role.CONSTRAINT_RESISTOR, f"s_{k}", (f"w_{k}", f"c_{k}"), gain)
            board.place_strain(k, f"c_{k}")
            row = board.T[k - 1] if self.feedback_inverts else -board.T[k - 1]
            if (row < 0.0).any():
                parts.inverting(f"z_{k}", f"w_{k}", f"z_{k}")

    def _connect(self, board: PlanesBoard, sinks: tuple[str, ...]) -> None:
        """Place both resistor matrices; the feedback ends at `sinks`, one node a channel."""
        rows = range(1, len(board.T) + 1)
        minus_u = tuple(f"a_{n}" for n in board.channels)
        plus_u = tuple(board.plus_u.get(n, "") for n in board.channels)
        w, z, sums = (tuple(f"{letter}_{k}" for k in rows) for letter in "wzc")
        plus, minus = (w, z) if self.feedback_inverts else (z, w)
        entries = matrix_resistors(board.T, board.scene)
        forward = ResistorMatrix("Rf", *entries, True, minus_u, plus_u, sums)
        board.parts.matrix(Role.FORWARD, forward)
        board.parts.matrix(Role.FEEDBACK, ResistorMatrix("Rb", *entries, False, plus, minus, sinks))

    def _omissions(self, board: PlanesBoard) -> Iterator[Omission]:
        """Yield the inverters and stages that are omitted."""
        design, T = board.scene.design, board.T
        linear, rows = design.amplifier == "linear", T[T.any(axis=1)]
        yield from _inverters("u", "columns", T.T, "positive" if linear else "negative")
        sign = "negative" if self.feedback_inverts else "positive"
        yield from _inverters("w", "rows", rows, sign)
        if linear:
            why = "linear amplifiers: the regulariser is the sum of squares"
            yield Omission("antilog stages and bias current", why)
        elif not design.biased:
            yield Omission("bias current", "design.bias is false, or the amplifier needs none")


def _inverters(signal: str, lines: str, entries: Floats, sign: str) -> Iterator[Omission]:
    """Yield how many `lines` of T need no inverter: none of their `entries` (P, Q) has the sign."""
    signed = entries > 0 if sign == "positive" else entries < 0
    if count := int(np.count_nonzero(~signed.any(axis=1))):
        yield Omission(f"{count} inverters of {signal}", f"their {lines} have no {sign} entry")
