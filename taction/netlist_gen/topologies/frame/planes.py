"""The board of two planes: signal nodes with amplifiers, constraint nodes, two matrices.

`Planes` is the frame of the topologies that differ in their signal nodes alone. It has only the
parts that the scene needs; `Circuit.omissions` has the others.

`AntilogStage` is the antilog stage of a channel as parts: a matched pair, two op-amps and an input
divider. The collector currents of two equal transistors with one emitter node have the ratio
``exp((v_b2 - v_b1) / V_T)`` (NPN; PNP: of the opposite sign). One op-amp drives the emitters so
that transistor 1 carries I_ref, the divider sets one base to ``v V_T / Ve``, the other base is on
ground, so transistor 2 carries ``I_ref exp(v / Ve)``. The second op-amp turns this current into a
voltage by ``R_t = U0 / I_ref``. `docs/network.md` derives it.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from taction.netlist_gen.board import parts as boards
from taction.netlist_gen.board.bill_of_materials import nearest, preferred
from taction.netlist_gen.board.circuit import GROUND, Circuit, Omission, Output, Role
from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame import topology as frame
from taction.netlist_gen.topologies.frame.topology import GrowingBoard, Topology
from taction.spice_models.opamp import OpAmp
from taction.spice_models.transistor import Transistor, load_pairs, thermal_voltage
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError

REFERENCE, REFERENCE_VOLTS = "reference", 5.0


@dataclass(frozen=True, slots=True)
class AntilogStage:
    """The values of the parts of every stage, ohm and F; a capacitor of 0 is left out."""

    pair: Transistor
    divider: float  # from v to the divided base
    base: float  # from there to ground
    reference: float  # from the reference voltage to collector 1
    emitter: float  # from the reference op-amp to the emitters
    output: float  # R_t
    reference_capacitor: float  # across the reference op-amp
    output_capacitor: float  # across R_t

    @classmethod
    def of(cls, scene: Scene, opamp: OpAmp) -> AntilogStage:
        """Choose the parts for a scene; InputError for a slope below the thermal voltage."""
        if scene.analysis.initial != "rest":
            text = (
                "transistors start at their operating point; expected 'rest' with antilog 'device'"
            )
            raise InputError(scene.file, Complaint("analysis.initial", "'zero'", text))
        design, choice = scene.design, scene.design.antilog
        pair = load_pairs()[choice.transistors]
        volts = thermal_voltage(choice.nominal_temperature)
        series = design.resistor_series
        ratio = (design.exponential_slope or 1.0) / volts - 1.0
        if not ratio > 0.0:
            text = f"a divider only reduces v: must be above the thermal voltage of {volts:.5g} V"
            slope = f"{design.exponential_slope} V"
            raise InputError(scene.file, Complaint("design.exponential_slope", slope, text))
        emitter = preferred(choice.emitter_resistance, series)
        output = preferred(design.unit_voltage / choice.reference_current, series)
        node = design.stray_capacitance + opamp.input_capacitance + opamp.differential_capacitance
        node += pair.collector_capacitance
        capacitors = [compensation(ohms, opamp.gbw, node) for ohms in (emitter, output)]
        first, second = nearest(np.array(capacitors), design.capacitor_series).tolist()
        return cls(
            pair=pair,
            divider=preferred(choice.divider_resistance * ratio, series),
            base=preferred(choice.divider_resistance, series),
            reference=preferred(REFERENCE_VOLTS / choice.reference_current, series),
            emitter=emitter,
            output=output,
            reference_capacitor=first,
            output_capacitor=second,
        )

    def place(self, board: GrowingBoard, n: int) -> str:
        """Place the stage of channel `n`; return its output: -u of a PNP pair, +u of an NPN pair.

        The divider is at the base at which the output current rises with v.
        """
        npn = self.pair.polarity == "npn"
        source, output = f"v_{n}", f"u_{n}" if npn else f"a_{n}"
        base, emitters, collector, drive, current = (f"{letter}_{n}" for letter in "beydt")
        role, name = Role.STAGE, self.pair.name
        if n == 1:
            volts = self.pair.sign * REFERENCE_VOLTS
            board.place(boards.VoltageSource(REFERENCE, REFERENCE, volts), role)
        board.opamp(drive, collector, drive, role=role)
        board.opamp(output, current, output, role=role)
        board.place(boards.Resistor(f"div_{n}", source, base, self.divider), role)
        board.place(boards.Resistor(f"base_{n}", base, GROUND, self.base), role)
        board.place(boards.Resistor(f"ref_{n}", REFERENCE, collector, self.reference), role)
        board.place(boards.Resistor(f"em_{n}", drive, emitters, self.emitter), role)
        board.place(boards.Resistor(f"out_{n}", output, current, self.output), role)
        if self.reference_capacitor > 0.0:
            board.capacitor(role, f"ref_{n}", (drive, collector), self.reference_capacitor)
            board.capacitor(role, f"out_{n}", (output, current), self.output_capacitor)
        first, second = (GROUND, base) if npn else (base, GROUND)
        board.place(boards.TransistorCell(f"ref_{n}", name, collector, first, emitters), role)
        board.place(boards.TransistorCell(f"out_{n}", name, current, second, emitters), role)
        return output


def compensation(ohms: float, gbw: float, node: float) -> float:
    """Return the capacitor from the output of an op-amp to its inverting input, F.

    The input has a capacitance `node` to ground, and the output drives it through `ohms` as well.
    With ``g = 1 / ohms`` the gain of the loop is ``w_t / s (s C + g) / (s (C + node))``. The C
    returned puts its zero at half of the crossover, ``C² / (C + node) = 2 g / w_t``: a phase margin
    of atan 2 = 63 degrees without further poles. It is 0 for an op-amp without poles.

    >>> C = compensation(1e4, 1e6, 45e-12)
    >>> round(C**2 / (C + 45e-12) * 1e4 * 2e6 * math.pi, 9)
    2.0
    """
    if math.isinf(gbw):
        return 0.0
    share = 1.0 / (ohms * 2.0 * math.pi * gbw)
    return share + math.sqrt(share**2 + 2.0 * share * node)


def with_ideal_stages(circuit: Circuit) -> Circuit:
    """Return `circuit` with the function ``U0 exp(v/Ve)`` itself as its stages."""
    if not circuit.transistors:
        return circuit
    stage, scales = circuit.named(Role.STAGE), (circuit.value("U0"), circuit.value("Ve"))
    kept: dict[str, Any] = {
        kind: tuple(part for part in getattr(circuit, kind) if part.card not in stage)
        for kind in ("opamps", "resistors", "capacitors", "voltages")
    }
    amplifiers = tuple(
        boards.SignalAmplifier(
            output.node, circuit.amplifier, node, output.node, -output.sign * scales[0], scales[1]
        )
        for node, output in zip(circuit.signal_nodes, circuit.outputs, strict=True)
    )
    return replace(circuit, **kept, amplifiers=amplifiers, transistors=(), transistor_models={})


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
        ohms = self.facts["R"].value * design.unit_voltage / frame.slope_of(self.scene)
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
                board.resistor(Role.RIDGE_RESISTOR, f"ridge_{n}", (source, sinks[-1]), ridge)
        return tuple(sinks)

    def _amplifier(self, board: PlanesBoard, n: int, *, minus: bool, plus: bool) -> None:
        """Place the signal amplifier of channel `n`, with an inverter where both signs are used."""
        design = board.scene.design
        if design.amplifier == "linear":
            output, inverts = self.linear_output(board, n), False
        elif board.stage is None:
            output, inverts = f"a_{n}", True
            scales = design.unit_voltage, frame.slope_of(board.scene)
            board.place(boards.SignalAmplifier(output, design.amplifier, f"v_{n}", output, *scales))
        else:
            output, inverts = board.stage.place(board, n), board.stage.pair.polarity != "npn"
        board.outputs.append(Output(output, -1.0 if inverts else 1.0))
        if not inverts:
            board.plus_u[n] = output
        if plus if inverts else minus:
            other = f"u_{n}" if inverts else f"a_{n}"
            board.inverting(other, output, other)
            if inverts:
                board.plus_u[n] = other

    def _constraint_plane(self, board: PlanesBoard) -> None:
        """Place constraint nodes, the sources of the strain and inverters of w."""
        gain = board.scene.design.gain
        for k in board.sensors:
            board.opamp(f"c_{k}", f"c_{k}", f"w_{k}")
            board.resistor(Role.CONSTRAINT_RESISTOR, f"s_{k}", (f"w_{k}", f"c_{k}"), gain)
            board.place_strain(k, f"c_{k}")
            row = board.T[k - 1] if self.feedback_inverts else -board.T[k - 1]
            if (row < 0.0).any():
                board.inverting(f"z_{k}", f"w_{k}", f"z_{k}")

    def _connect(self, board: PlanesBoard, sinks: tuple[str, ...]) -> None:
        """Place both resistor matrices; the feedback ends at `sinks`, one node a channel."""
        rows = range(1, len(board.T) + 1)
        minus_u = tuple(f"a_{n}" for n in board.channels)
        plus_u = tuple(board.plus_u.get(n, "") for n in board.channels)
        w, z, sums = (tuple(f"{letter}_{k}" for k in rows) for letter in "wzc")
        plus, minus = (w, z) if self.feedback_inverts else (z, w)
        entries = frame.matrix_resistors(board.T, board.scene)
        forward = boards.ResistorMatrix("Rf", *entries, True, minus_u, plus_u, sums)
        feedback = boards.ResistorMatrix("Rb", *entries, False, plus, minus, sinks)
        board.place(forward, Role.FORWARD)
        board.place(feedback, Role.FEEDBACK)

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
