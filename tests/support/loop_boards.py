"""Random closed-loop boards, compared with their nodal equations written from T alone.

Every board has a random T, way of negative entries, op-amp of one or two poles, and capacitances at
its inputs. The witness is a list of resistors and op-amps made here, and numpy: an op-amp has
``q' = wt (v+ - v-) - wp q`` and a lag ``t2 o' = q - o``, an input node ``C v' = sum g (v_k - v)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from scipy.optimize import linear_sum_assignment

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import EPS, Floats
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene
from tests.support.readings import Samples

TOPOLOGIES = ("inv", "pinv", "ridge")
WAYS = ("inverters", "differential", "offset")
BAND = 0.01  # of the settling time
POINTS, LIVES = 20_001, 12.0  # of the transient: instants, and time constants
INVERTER = 1e4  # ohm
WELL_CONDITIONED = 1e7  # of the modes, with which their sum is the transient
SAME = 1e-10  # relative error of the settling time of that sum, by rounding


@dataclass(frozen=True)
class Comparison:
    """One board; `outside` names the numbers that are beyond their bounds."""

    topology: str
    way: str
    channels: int
    poles: int
    stable: bool
    settling: bool  # whether its settling time was compared
    doubt: float  # stated error of the settling time over it
    outside: tuple[str, ...]

    @property
    def counts(self) -> dict[str, float]:
        """What a study adds up."""
        return {"stable": self.stable, "settling times": self.settling, "poles": self.poles}


@dataclass
class Network:
    """Resistors between nodes and op-amps, and the state equations that follow."""

    conductances: list[tuple[str, str, float]] = field(default_factory=list)
    opamps: list[tuple[str, str, str]] = field(default_factory=list)  # plus, minus, output
    amps: dict[str, float] = field(default_factory=dict)  # into nodes

    def resistor(self, a: str, b: str, siemens: float) -> None:
        if siemens and a and b:
            self.conductances.append((a, b, siemens))

    def stages(self, letter: str, T: Floats, way: str) -> list[tuple[str, str]]:
        """Return the two inputs of the op-amp of each row: the other one is ground if unused."""
        used = (T < 0.0).any(axis=1) & (way == "differential")
        return [(f"{letter}{k}", f"{letter}m{k}" if used[k] else "0") for k in range(len(T))]

    def array(
        self, T: Floats, G0: float, drivers: list[str], sinks: list[tuple[str, str]], way: str
    ) -> None:
        """Place an array, rows of T at the sinks, and what its negative entries need."""
        below = max(0.0, -float(T.min())) if way == "offset" else 0.0
        for k, (first, other) in enumerate(sinks):
            for n, driver in enumerate(drivers):
                siemens = G0 * float(T[k, n] + below)
                if way == "differential" and siemens < 0.0:
                    self.resistor(driver, other, -siemens)
                else:
                    self.resistor(driver if siemens >= 0.0 else f"-{driver}", first, abs(siemens))
            self.resistor(f"sum{drivers[0]}", first, G0 * below)
        if below:
            self.inverter(drivers, f"sum{drivers[0]}")
        for n, driver in enumerate(drivers):
            if way == "inverters" and (T[:, n] < 0.0).any():
                self.inverter([driver], f"-{driver}")

    def inverter(self, drivers: list[str], output: str) -> None:
        """Place an inverter of a sum."""
        for node in (*drivers, output):
            self.resistor(node, f"j{output}", 1.0 / INVERTER)
        self.opamps.append(("0", f"j{output}", output))

    def load(self, node: str) -> float:
        return math.fsum(g for a, b, g in self.conductances for end in (a, b) if end == node)

    def equations(self, figures: dict[str, float]) -> tuple[Floats, Floats]:
        """Return A and b of ``x' = A x + b`` for ``x = [q, o, inputs]``; without t2 or C fewer."""
        outputs = {out: k for k, (_, _, out) in enumerate(self.opamps)}
        ends = {node for plus, minus, _ in self.opamps for node in (plus, minus)} - {"0"}
        inputs = {node: k for k, node in enumerate(sorted(ends - set(outputs)))}
        P, n = len(outputs), len(inputs)
        Y, F, amps, C = np.zeros((n, n)), np.zeros((n, P)), np.zeros(n), np.zeros(n)
        for a, b, siemens in self.conductances:
            for node, other in ((a, b), (b, a)):
                if node in inputs:
                    Y[inputs[node], inputs[node]] += siemens
                    if other in inputs:
                        Y[inputs[node], inputs[other]] -= siemens
                    elif other in outputs:
                        F[inputs[node], outputs[other]] += siemens
        for node, current in self.amps.items():
            amps[inputs[node]] += current
        E = np.zeros((P, n))
        for row, (plus, minus, _) in enumerate(self.opamps):
            for node, sign in ((plus, 1.0), (minus, -1.0)):
                if node in inputs:
                    E[row, inputs[node]] += sign
                    C[inputs[node]] += figures["input_capacitance"]
        wt = math.tau * figures["gbw"]
        wp, eye, zero = wt / figures["dc_gain"], np.eye(P), np.zeros((P, P))
        lag = figures.get("second_pole", math.inf)
        rate = math.tau * lag
        if not C.any():
            S, drive = E @ np.linalg.solve(Y, F), E @ np.linalg.solve(Y, amps)
            if math.isinf(lag):
                return wt * S - wp * eye, wt * drive
            A = np.block([[-wp * eye, wt * S], [rate * eye, -rate * eye]])
            return A, np.append(wt * drive, np.zeros(P))
        down = 1.0 / C[:, None]
        if math.isinf(lag):
            A = np.block([[-wp * eye, wt * E], [down * F, -down * Y]])
            return A, np.append(np.zeros(P), down[:, 0] * amps)
        none = np.zeros((P, n))
        A = np.block(
            [[-wp * eye, zero, wt * E], [rate * eye, -rate * eye, none],
             [none.T, down * F, -down * Y]]
        )  # fmt: skip
        return A, np.append(np.zeros(2 * P), down[:, 0] * amps)


def board_scene(seed: int) -> Scene:
    """Return the scene of a seed."""
    rng = np.random.default_rng([27, seed])
    topology, way = TOPOLOGIES[seed % 3], WAYS[seed // 3 % 3]
    N = int(rng.integers(2, 13))
    M = N if topology == "inv" else N + int(rng.integers(0, 4))
    T = 0.3 * rng.standard_normal((M, N)) * (rng.random((M, N)) < 0.8)
    T[:, 0] += 0.2  # no row without an entry
    T[:N] += np.diag(rng.uniform(0.5, 1.5, N)) * (1.0 + 0.3 * math.sqrt(N) * (topology == "inv"))
    gbw = float(10.0 ** rng.uniform(6.0, 8.0))
    opamp: dict[str, Any] = {
        "base": "ideal", "dc_gain": float(10.0 ** rng.uniform(4.0, 7.0)), "gbw": gbw,
        "output_resistance": 0.0,
    }  # fmt: skip
    if rng.random() < 0.5:
        opamp["second_pole"] = gbw * float(10.0 ** rng.uniform(0.0, 1.5))
    if rng.random() < 0.5:
        opamp["input_capacitance"] = float(10.0 ** rng.uniform(-13.0, -11.0))
    design = {
        "topology": topology, "negative_entries": way, "opamp": opamp,
        "unit_conductance": float(10.0 ** rng.uniform(-5.0, -3.5)), "stray_capacitance": 0,
        "strain_input": ("current", "voltage")[int(rng.integers(2))],
        "inverter_resistance": INVERTER,
        **({"lambda": float(10.0 ** rng.uniform(-2.0, 0.0))} if topology == "ridge" else {}),
    }  # fmt: skip
    if topology != "inv":
        factor = float(10.0 ** rng.uniform(-0.5, 1.0))
        design["feedback_conductance"] = design["unit_conductance"] * factor
    problem = {"kind": "matrix", "matrix": T.tolist(), "strain": rng.standard_normal(M).tolist()}
    checks = {"settling_time": {"band": BAND}}
    return make_scene(problem, design=design, checks=checks, analysis={"engine": "statespace"})


def network(scene: Scene) -> Network:
    """Return the board of a scene, from T, the strain and the numbers of the design."""
    design, found = scene.design, Network()
    T, eps = np.array(scene.problem.matrix), np.array(scene.problem.strain)
    G0, way, (M, N) = float(design.unit_conductance), design.negative_entries, T.shape
    tall, gf = design.topology != "inv", float(design.feedback_conductance or 0.0)
    rows = found.stages("r", T, way)
    for k, (first, other) in enumerate(rows):
        found.amps[first] = float(eps[k]) * G0
        if design.strain_input == "voltage":
            found.resistor(first, "0", G0)
        output = f"w{k}" if tall else f"v{k}"
        found.opamps.append((other, first, output))
        if tall:
            found.resistor(first, output, gf)
            if other != "0":
                found.resistor(other, "0", gf)
    found.array(T, G0, [f"v{n}" for n in range(N)], rows, way)
    pairs = list(rows)
    if tall:
        columns = found.stages("c", T.T, way)
        found.opamps += [(*pair, f"v{n}") for n, pair in enumerate(columns)]
        found.array(T.T, G0, [f"w{k}" for k in range(M)], columns, way)
        pairs += columns
    if design.topology == "ridge":
        root = math.sqrt(float(design.lam)) * G0
        for n in range(N):
            found.resistor(f"v{n}", f"l{n}", root)
            found.resistor(f"l{n}", f"y{n}", gf)
            found.resistor(f"y{n}", columns[n][0], root)
            found.opamps.append(("0", f"l{n}", f"y{n}"))
    for first, other in pairs:  # both inputs of an op-amp are loaded alike
        if other != "0":
            less = found.load(first) - found.load(other)
            found.resistor(other if less > 0.0 else first, "0", abs(less))
    return found


def answer(scene: Scene) -> Floats:
    """Return the solution of the problem, by numpy's least squares."""
    T, eps = np.array(scene.problem.matrix), np.array(scene.problem.strain)
    if scene.design.topology == "ridge":
        T = np.vstack([T, math.sqrt(float(scene.design.lam)) * np.eye(T.shape[1])])
        eps = np.append(eps, np.zeros(T.shape[1]))
    return np.asarray(np.linalg.lstsq(T, eps, rcond=None)[0])


def refined(A: Floats, b: Floats) -> Floats:
    """Return the solution of ``A x = -b`` with residuals of 64 bits."""
    x = np.zeros(len(b), dtype=np.longdouble)
    for _ in range(6):
        x -= np.linalg.solve(A, (b + A.astype(np.longdouble) @ x).astype(np.float64))
    return x.astype(np.float64)


def opamp_figures(scene: Scene) -> dict[str, float]:
    """Return the figures of the op-amp of a scene."""
    given = {key: value for key, value in scene.design.opamp.model_dump().items() if value}
    return {"second_pole": math.inf, "input_capacitance": 0.0, **given}


def compare_board(seed: int) -> Comparison:
    """Compare rest, poles and settling time of the board of a seed."""
    scene = board_scene(seed)
    design, found = scene.design, verify(scene)
    made = network(scene)
    figures = opamp_figures(scene)
    A, b = made.equations(figures)
    outside = list[str]()
    values, left, right = scipy.linalg.eig(A, left=True)
    doubt = len(A) * EPS * float(np.linalg.norm(A)) / np.abs((left.conj() * right).sum(axis=0))
    if not poles_agree(found, values, doubt):
        outside.append("poles")
    P, N = len(made.opamps), len(found.circuit.outputs)
    first = P if math.isfinite(figures["second_pole"]) else 0
    places = [first + [out for *_, out in made.opamps].index(f"v{n}") for n in range(N)]
    rest = -refined(A, b)[places]
    apart = np.abs(found.steady.values - rest).max()
    if apart > found.steady.error + 8.0 * EPS * np.abs(rest).max():
        outside.append("rest")
    stable, settled = bool(values.real.max() < 0.0), None
    if stable and np.linalg.cond(right) < WELL_CONDITIONED:
        settled = settles(found, answer(scene), rest, values, right, places, b)
        if settled is False:
            outside.append("settling")
    reading = found.measurements.settling_time
    share = reading.uncertainty / reading.value if reading and reading.value else 0.0
    return Comparison(design.topology, design.negative_entries, N, len(A), stable,
                      settled is not None, share, tuple(outside))  # fmt: skip


def poles_agree(found: Verdict, values: Floats, doubt: Floats) -> bool:
    """Tell whether every pole of the engine has one of the witness within both errors."""
    own = found.poles
    if len(own.poles) != len(values):
        return False
    apart = np.abs(own.poles[:, None] - values)
    pairs = linear_sum_assignment(apart)
    return bool(np.all(apart[pairs] <= own.errors[pairs[0]] + doubt[pairs[1]]))


def settles(
    found: Verdict, target: Floats, rest: Floats, poles: Floats, right: Floats,
    places: list[int], drive: Floats,
) -> bool:  # fmt: skip
    """Tell whether the settling time is that of the sum of modes."""
    reading = found.measurements.settling_time
    slowest = -float(poles.real.max())
    shares = -right[places] * np.linalg.solve(right, drive) / poles  # of u = -v

    def largest(t: float) -> float:
        return float(np.abs(rest + (shares @ np.exp(poles * t)).real - target).max())

    end = 3.0 / slowest + (1.5 * reading.value if reading else LIVES / slowest)
    times = np.linspace(0.0, end, POINTS)
    errors = np.abs(rest + (np.exp(np.outer(times, poles)) @ shares.T).real - target).max(axis=1)
    samples = Samples(times, errors, largest, float(np.abs(rest - target).max()))
    last = samples.last_outside(BAND * float(np.abs(target).max()))
    if last is None or reading is None:
        return last is reading
    return abs(last - reading.value) <= reading.uncertainty + SAME * last
