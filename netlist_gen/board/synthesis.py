"""From a scene and its problem to a `Circuit`: signs, scalings, and only the parts in use.

Topology ``integrator`` sums every current into a virtual ground, so that no resistor loads a node
and eq (9), in its corrected form, holds exactly for ideal op-amps::

    signal node n      op-amp, R || C from v_n to the summing node x_n
    signal amplifier   inverter (linear) or antilog stage, a_n = -u_n
    constraint node k  op-amp, feedback s, strain current into c_k; w_k = s G0 (T u - eps U0)_k
    matrix forward     T_kn > 0: a_n -> c_k     T_kn < 0: +u_n -> c_k
    matrix feedback    T_kn > 0: w_k -> x_n     T_kn < 0: -w_k -> x_n
    bias               I_b as Ve through R into x_n (entropy only)

Topology ``passive`` (Hopfield's) has R and C from v_n to ground, the feedback resistors at v_n
(with the opposite signs), and a buffer; R_n is larger to compensate the load of these resistors.
"""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.antilog import AntilogStage
from taction.netlist_gen.board.circuit import (
    GROUND,
    Capacitor,
    Circuit,
    CurrentSource,
    NoiseCurrent,
    Output,
    Resistor,
    ResistorMatrix,
    Scalings,
    SignalAmplifier,
    VoltageSource,
)
from taction.netlist_gen.board.omissions import list_omissions
from taction.netlist_gen.board.parts import Parts
from taction.netlist_gen.board.preferred_values import nearest
from taction.netlist_gen.board.pruning import pruned
from taction.netlist_gen.board.scalings import choose_opamp, make_scalings, preferred
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Bools, Floats
from taction.system.errors import Complaint, InputError

BIAS = "bias"


def synthesise(scene: Scene, problem: InverseProblem | None = None) -> Circuit:
    """Design the board of `scene` for `problem`, by default the scene's own problem.

    Raises
    ------
    InputError
        A number of the design is out of range, or the passive topology needs a negative resistor.

    Examples
    --------
    >>> import taction
    >>> circuit = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> len(circuit.outputs), circuit.topology
    (7, 'integrator')
    """
    problem = make_problem(scene) if problem is None else problem
    scalings = make_scalings(scene)
    model = choose_opamp(scene)
    kept = pruned(problem.matrix, scene.design.prune)
    ohms, negative = matrix_resistors(kept, scene)
    inverter = preferred(scene.design.inverter_resistance, scene)
    parts = Parts(model.name, scene.design.stray_capacitance, inverter)
    stage = AntilogStage.of(scene, model) if scene.design.antilog.has_devices else None
    board = _Board(scene, scalings, ohms, negative, parts, stage)
    board.signal_plane()
    board.constraint_plane(problem.strain * scalings.unit_conductance * scalings.unit_voltage)
    board.connect()
    return Circuit(
        name=scene.name,
        amplifier=scene.design.amplifier,
        topology=scene.design.topology,
        scalings=scalings,
        models={model.name: model},
        opamps=tuple(parts.opamps),
        amplifiers=tuple(parts.amplifiers),
        resistors=tuple(parts.resistors),
        matrices=tuple(parts.matrices),
        capacitors=tuple(parts.capacitors),
        currents=tuple(parts.currents),
        voltages=tuple(parts.voltages),
        signal_nodes=tuple(f"v_{n}" for n in board.channels),
        constraint_nodes=tuple(f"w_{k}" for k in board.sensors),
        outputs=tuple(board.outputs),
        omissions=list_omissions(scene, problem, kept, model),
        supply=scene.design.supply,
        noises=tuple(parts.noises),
        transistors=tuple(parts.transistors),
        transistor_models={} if stage is None else {stage.pair.name: stage.pair},
        temperature=scene.design.antilog.temperature,
    )


def matrix_resistors(matrix: Floats, scene: Scene) -> tuple[Floats, Bools]:
    """Return ohms ``1 / (|T| G0)``, infinite for T = 0, and whether T is negative; both (M, N)."""
    with np.errstate(divide="ignore"):
        ohms = 1.0 / (np.abs(matrix) * scene.design.unit_conductance)
    return nearest(ohms, scene.design.resistor_series), matrix < 0


def realised_matrix(circuit: Circuit) -> Floats:
    """Return the T (M, N) of the resistors of `circuit`, with their rounding."""
    forward = circuit.matrices[0]
    sign = np.where(forward.negative, -1.0, 1.0)
    return sign / (forward.ohms * circuit.scalings.unit_conductance)


class _Board:
    """A synthesis that places the parts plane by plane."""

    def __init__(
        self,
        scene: Scene,
        scalings: Scalings,
        ohms: Floats,
        negative: Bools,
        parts: Parts,
        stage: AntilogStage | None,
    ) -> None:
        self.scene, self.design, self.parts = scene, scene.design, parts
        self.resistance, self.capacitance = scalings.resistance, scalings.capacitance
        self.ohms, self.negative, self.stage = ohms, negative, stage
        self.present = np.isfinite(ohms)
        self.rounded = preferred(scalings.resistance, scene)
        self.linear = scene.design.amplifier == "linear"
        self.passive = scene.design.topology == "passive"
        self.channels = range(1, ohms.shape[1] + 1)
        self.sensors = (1 + np.flatnonzero(self.present.any(axis=1))).tolist()
        self.outputs: list[Output] = []
        self.plus_u: dict[int, str] = {}

    def signal_plane(self) -> None:
        """Place signal nodes, their amplifiers and the bias."""
        needs_minus = np.any(self.present & ~self.negative, axis=0).tolist()
        needs_plus = np.any(self.present & self.negative, axis=0).tolist()
        place = self._passive_node if self.passive else self._integrator
        for n in self.channels:
            place(n)
            minus, plus = needs_minus[n - 1], needs_plus[n - 1]
            if self.linear:
                self._linear_stage(n, minus=minus)
            elif self.stage is None:
                self._antilog_stage(n)
                self._invert_minus(n, plus=plus)
            else:
                self._transistor_stage(n, self.stage, minus=minus, plus=plus)

    def constraint_plane(self, amps: Floats) -> None:
        """Place constraint nodes, strain currents `amps` (M,) and inverters of w."""
        feedback_negative = ~self.negative if self.passive else self.negative
        needs_inverter = np.any(self.present & feedback_negative, axis=1).tolist()
        gain, currents = preferred(self.design.gain, self.scene), amps.tolist()
        density = self.design.sensor_noise
        for k in self.sensors:
            self.parts.opamp(f"c_{k}", f"c_{k}", f"w_{k}")
            self.parts.resistors.append(Resistor(f"s_{k}", f"w_{k}", f"c_{k}", gain))
            if currents[k - 1] != 0:
                self.parts.currents.append(CurrentSource(f"eps_{k}", f"c_{k}", currents[k - 1]))
            if density > 0.0:
                self.parts.noises.append(NoiseCurrent(f"eps_{k}", f"c_{k}", density))
            if needs_inverter[k - 1]:
                self.parts.inverting(f"z_{k}", f"w_{k}", f"z_{k}")

    def connect(self) -> None:
        """Place the two resistor matrices; feedback has the opposite sign where it is passive."""
        rows = range(1, self.ohms.shape[0] + 1)
        minus_u = tuple(f"a_{n}" for n in self.channels)
        plus_u = tuple(self.plus_u.get(n, "") for n in self.channels)
        w, z = tuple(f"w_{k}" for k in rows), tuple(f"z_{k}" for k in rows)
        sums = tuple(f"c_{k}" for k in rows)
        nodes = tuple(f"v_{n}" if self.passive else f"x_{n}" for n in self.channels)
        plus, minus = (z, w) if self.passive else (w, z)
        self.parts.matrices += [
            ResistorMatrix("Rf", self.ohms, self.negative, True, minus_u, plus_u, sums),
            ResistorMatrix("Rb", self.ohms, self.negative, False, plus, minus, nodes),
        ]

    def _integrator(self, n: int) -> None:
        parts, x, v, ohms = self.parts, f"x_{n}", f"v_{n}", self.rounded
        parts.opamp(f"v_{n}", x, v)
        parts.resistors.append(Resistor(f"r_{n}", v, x, ohms))
        parts.capacitors.append(Capacitor(f"c_{n}", v, x, self.capacitance))
        if self.design.biased:
            if n == 1:
                slope = self.design.exponential_slope or 1.0
                parts.voltages.append(VoltageSource(BIAS, BIAS, slope))
            parts.resistors.append(Resistor(f"bias_{n}", BIAS, x, ohms))

    def _passive_node(self, n: int) -> None:
        parts, v = self.parts, f"v_{n}"
        load = float(np.sum(1.0 / self.ohms[:, n - 1]))
        left = 1.0 / self.resistance - load
        if left <= 0:
            text = (
                f"the matrix loads channel {n} of the passive topology with {load:.6g} S, so R must"
                f" be below {1.0 / load:.6g} ohm; increase lambda or use topology = 'integrator'"
            )
            value = f"{self.resistance:.6g} ohm"
            raise InputError(self.scene.file, Complaint("design.resistance", value, text))
        parts.resistors.append(Resistor(f"r_{n}", v, GROUND, preferred(1.0 / left, self.scene)))
        parts.capacitors.append(Capacitor(f"c_{n}", v, GROUND, self.capacitance))
        parts.stray_at(v)
        if self.design.biased:
            text = "topology 'passive' has no virtual ground for a bias current; set bias = false"
            raise InputError(self.scene.file, Complaint("design.bias", "true", text))

    def _linear_stage(self, n: int, *, minus: bool) -> None:
        u = f"v_{n}"
        if self.passive:
            u = f"u_{n}"
            self.parts.follower(f"u_{n}", f"v_{n}", u)
        self._invert_plus(n, u, minus=minus)

    def _invert_plus(self, n: int, u: str, *, minus: bool) -> None:
        self.plus_u[n] = u
        self.outputs.append(Output(u, 1.0))
        if minus:
            self.parts.inverting(f"a_{n}", u, f"a_{n}")

    def _antilog_stage(self, n: int) -> None:
        scales = self.design.unit_voltage, self.design.exponential_slope or 1.0
        stage = SignalAmplifier(f"a_{n}", self.design.amplifier, f"v_{n}", f"a_{n}", *scales)
        self.parts.amplifiers.append(stage)

    def _transistor_stage(self, n: int, stage: AntilogStage, *, minus: bool, plus: bool) -> None:
        output = stage.place(self.parts, n)
        if stage.pair.polarity == "npn":
            self._invert_plus(n, output, minus=minus)
        else:
            self._invert_minus(n, plus=plus)

    def _invert_minus(self, n: int, *, plus: bool) -> None:
        self.outputs.append(Output(f"a_{n}", -1.0))
        if plus:
            self.parts.inverting(f"u_{n}", f"a_{n}", f"u_{n}")
            self.plus_u[n] = f"u_{n}"
