"""The ideal network of a scene: steady state and transient.

``C dv/dt = -v/R - I_b - s G0 T^T (G0 T u - G0 U0 eps)``, ``u = U0 g(v/Ve)`` (eq 9 as corrected). In
``x = v/Ve`` and ``t/(R C)`` this is ``dx = -(x + beta) - T^T (T g(x) - eps) / mu``: of all its
components only mu, a multiple of lambda, is left. Its rest state solves the reference problem. The
transient follows from modes for linear amplifiers, by Radau for all others.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.scene.fields import LARGE, SMALL
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.system import plugins
from taction.system.array_types import Bools, Floats
from taction.system.errors import Complaint, InputError
from taction.system.reading_definitions import SETTLING_BAND
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS, Regulariser
from taction.verification.reference.solve import solve, solve_square


@dataclass(frozen=True, slots=True)
class AtOnce:
    """A network without capacitors: with ideal op-amps it is at rest at once."""

    solver: Callable[[Problem], Solution]  # solves the problem of its rest
    regularised: bool = False  # whether lambda stands in it; else it is 0


@dataclass(frozen=True, slots=True, eq=False)
class IdealNetwork:
    """A problem as a network with ideal op-amps; it has no components."""

    T: Floats  # (M, N)
    eps: Floats  # (M,)
    lam: float  # regularisation parameter
    RC: float  # time constant of a signal node, s; 0 of a network without capacitors
    U0: float = 1.0  # unit voltage, V
    amplifier: str = "linear"  # a key of `REGULARISERS`
    Ve: float = 1.0  # slope of a nonlinear amplifier, V; unused by the linear amplifier
    bias: bool = False  # whether ``I_b = Ve / R`` flows
    solver: Callable[[Problem], Solution] = solve
    ridge_share: float = 1.0  # share of the ridge term that stays

    @property
    def flows(self) -> bool:
        """Whether it comes to rest by the flow of this module, and not at once."""
        return self.RC > 0.0

    @property
    def rest(self) -> Solution:
        """Solution of the network's problem, by its own solver.

        SolverError: the solver can return no answer.
        """
        return self.solver(self.problem)

    @property
    def unit(self) -> float:
        """Voltage at which ``x = 1``: Ve, and U0 for a linear amplifier, V."""
        return self.U0 if self.amplifier == "linear" else self.Ve

    @property
    def mu(self) -> float:
        """Lambda for linear amplifiers, half of lambda for the others."""
        return self.lam * REGULARISERS[self.amplifier].weight

    @property
    def problem(self) -> Problem:
        """Problem that the network's rest state solves."""
        return Problem(self.T, self.eps, self.lam, self.amplifier, self.bias, self.ridge_share)


def lambda_times_resistance(
    amplifier: str, *, s: float, G0: float, U0: float = 1.0, Ve: float = 1.0
) -> float:
    """Return the product of lambda and the feedback resistor R of a board, ohm.

    In the equation of the network above ``mu = unit / (R s G0^2 U0)``, where `unit` is U0 for
    linear amplifiers and Ve for all others; ``lambda = mu / weight``, with the weight of eq (8) or
    (21) as corrected. The synthesis of the board has a formula of its own for the same product.

    `s`: gain of the constraint plane, ohm; `G0`: unit conductance, S.
    `U0`, `Ve`: unit voltage and slope of the amplifier, V.
    """
    volts = 1.0 if amplifier == "linear" else Ve / U0
    return volts / REGULARISERS[amplifier].weight / G0 / G0 / s


HALVINGS = 50  # of an interval in the search for an instant


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Outputs of the ideal network as a function of time."""

    time: Floats  # s, increasing from 0, dense enough for at most one crossing in an interval
    outputs: Callable[[Floats], Floats]  # ``t (K,) -> u (K, N)``, V, for t within `time`
    start: Floats  # outputs at time 0 (N,), V
    target: Floats  # outputs at rest (N,), V

    @property
    def amplitude(self) -> float:
        """Step amplitude ``max |u(inf) - u(0)|``, V."""
        return float(np.max(np.abs(self.target - self.start)))

    def settling_time(self, band: float = SETTLING_BAND) -> float:
        """Return the last instant, s, at which any channel is outside the band around its target.

        `band` is the half-width over the step amplitude. 0 if no channel moves; infinite if the
        record ends outside the band.
        """
        limit = band * self.amplitude

        def outside(time: Floats) -> Bools:
            return np.asarray(np.max(np.abs(self.outputs(time) - self.target), axis=1) > limit)

        places = np.flatnonzero(outside(self.time))
        if limit == 0.0 or not places.size:
            return 0.0
        if places[-1] == len(self.time) - 1:
            return float("inf")
        begin, end = self.time[places[-1] : places[-1] + 2].tolist()
        for _ in range(HALVINGS):
            middle = 0.5 * (begin + end)
            begin, end = (middle, end) if outside(np.array([middle]))[0] else (begin, middle)
        return float(end)


TOLERANCE = 1e-10
"""Relative tolerance of the integrator."""


def ideal_linear(network: IdealNetwork, v0: Floats, rest: Solution | None = None) -> Response:
    """Return the exact response of linear amplifiers in modal form.

    It is ``v(t) = v_inf + sum_i V_i exp(-(1 + sigma_i^2/mu) t/(R C)) V_i . (v0 - v_inf)``.

    `v0` (N,): signal-node voltages at time 0, V.
    `rest`: solution of the network's problem, if the caller has it already.
    ValueError: the amplifiers are not linear, or the network has no capacitors.
    """
    if network.amplifier != "linear":
        raise ValueError(f"modes are for linear amplifiers, not {network.amplifier}")
    if not network.flows:
        raise ValueError("a network without capacitors has no modes")
    M, N = network.T.shape
    _, sigma, Vt = np.linalg.svd(network.T, full_matrices=M < N)
    rates = np.ones(N)
    rates[: len(sigma)] += sigma**2 / network.mu
    rates /= network.RC
    target = (network.rest if rest is None else rest).u * network.U0
    start = np.asarray(v0, dtype=np.float64)
    amplitudes = Vt @ (start - target)

    def outputs(t: Floats) -> Floats:
        return np.asarray(target + (np.exp(-np.outer(t, rates)) * amplitudes) @ Vt)

    grid = np.geomspace(1e-3 / rates.max(), 40.0 / rates.min(), 4000)
    return Response(np.concatenate([[0.0], grid]), outputs, start, target)


class ScaledNetwork:
    """Right-hand side, Jacobian and energy in x and ``t/(R C)``, for any integrator."""

    def __init__(self, network: IdealNetwork) -> None:
        self.T, self.eps, self.mu = network.T, network.eps, network.mu
        self.beta, self.removed = float(network.bias), 1.0 - network.ridge_share
        self.g: Regulariser = REGULARISERS[network.amplifier]
        self.gram = self.T.T @ self.T / self.mu

    def slope(self, _: float, x: Floats) -> Floats:
        """dx/dt for x (N,) or (N, K)."""
        u = self.g.g(x)
        misfit = (self.T @ u).T - self.eps
        return np.asarray(-(x + self.beta) + self.removed * u - (misfit @ self.T).T / self.mu)

    def jacobian(self, _: float, x: Floats) -> Floats:
        """Return the derivative of `slope`, shape (N, N)."""
        slope = self.g.slope(x)
        return np.asarray(-self.gram * slope - np.diag(1.0 - self.removed * slope))

    def energy(self, x: Floats) -> float:
        """Return the dimensionless energy P of x (N,), up to a constant."""
        u = self.g.g(x)
        misfit = self.T @ u - self.eps
        penalty = self.g.energy(x) + self.beta * u - 0.5 * self.removed * u * u
        return float(misfit @ misfit / (2.0 * self.mu) + np.sum(penalty))

    def stiffness(self, x: Floats) -> float:
        """Return fastest over slowest rate; a similar matrix is symmetric, so rates are real."""
        A = self.T * np.sqrt(self.g.slope(x))
        sigma = np.linalg.svd(A, compute_uv=False) ** 2 / self.mu
        slowest = sigma[-1] if A.shape[0] >= A.shape[1] else 0.0
        return float((1.0 + sigma[0]) / (1.0 + slowest))


def ideal_transient(
    network: IdealNetwork, v0: Floats, stop: float | None = None, rest: Solution | None = None
) -> Response | None:
    """Integrate the ideal network with any amplifier by Radau.

    None where a value overflows, or the network is too stiff for double precision.

    `v0` (N,): signal-node voltages at time 0, V.
    `stop`: end time, s; by default long enough for the slowest mode to decay by 1e-8.
    `rest`: solution of the network's problem, if the caller has it already.
    SolverError: the steady state cannot be computed.
    """
    from scipy.integrate import solve_ivp

    scaled, unit = ScaledNetwork(network), network.RC
    rest = solve(network.problem) if rest is None else rest
    x0 = np.asarray(v0, dtype=np.float64) / network.unit
    at_rest = rest.u if rest.v is None else rest.v
    end = np.log(1e8 * (1.0 + np.max(np.abs(x0 - at_rest)))) if stop is None else stop / unit
    with np.errstate(all="ignore"):
        if not np.all(np.isfinite(scaled.slope(0.0, x0))):
            return None
        run = solve_ivp(
            scaled.slope, (0.0, float(end)), x0, "Radau", dense_output=True,
            jac=scaled.jacobian, rtol=TOLERANCE, atol=TOLERANCE,
        )  # fmt: skip
    dense = run.sol
    if not run.success or dense is None or not np.all(np.isfinite(run.y)):
        return None

    def outputs(t: Floats) -> Floats:
        return np.asarray(network.U0 * scaled.g.g(dense(np.asarray(t) / unit)).T)

    inner = np.linspace(0.0, 1.0, 8, endpoint=False)
    grid = (run.t[:-1, None] + np.diff(run.t)[:, None] * inner).ravel()
    time = np.append(grid, run.t[-1]) * unit
    return Response(time, outputs, network.U0 * scaled.g.g(x0), network.U0 * rest.u)


@dataclass(frozen=True, eq=False)
class IdealAnswer:
    """Steady state and transient of the ideal network."""

    network: IdealNetwork
    band: float  # half-width of the settling band, a fraction of the step amplitude
    solution: Solution  # the reference steady state, dimensionless, with its certificate
    # `start`, `target`: (N,): u at t = 0 and at rest, V.
    start: Floats
    target: Floats
    error: float  # bound on the error of `target`, as a fraction of the step amplitude
    initial: Floats  # (N,): voltages of the signal nodes at t = 0, V
    problem: str  # why the steady state cannot be trusted; empty for a trusted one

    @functools.cached_property
    def settling_time(self) -> float:
        """Settling time of the transient to the scene's band, s; computed at the first use.

        Not a number where the transient cannot be integrated.
        """
        if not self.network.flows:
            return 0.0
        if self.network.amplifier == "linear":
            return ideal_linear(self.network, self.start, self.solution).settling_time(self.band)
        found = ideal_transient(self.network, self.initial, rest=self.solution)
        return np.nan if found is None else found.settling_time(self.band)


def ideal_network(problem: InverseProblem, scene: Scene) -> IdealNetwork:
    """Return the ideal network of `problem`, with lambda and the units that `scene` asks for.

    It reads the scene alone, no number of the synthesis. Where the scene gives R, lambda follows
    from the reference's own formula.

    InputError: lambda is no number, or out of range.
    """
    design = scene.design
    at_once = NETWORKS.get(design.topology)
    if at_once is not None:
        lam = design.lam if at_once.regularised else 0.0
        if not isinstance(lam, int | float):
            text = "the problem needs a number for lambda"
            raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
        T, eps, volts = problem.matrix, problem.strain, design.unit_voltage
        return IdealNetwork(T, eps, float(lam), RC=0.0, U0=volts, solver=at_once.solver)
    kind, slope = design.amplifier, design.exponential_slope or 1.0
    product = lambda_times_resistance(
        kind, s=design.gain, G0=design.unit_conductance, U0=design.unit_voltage, Ve=slope
    )
    lam = design.lam
    if lam is None:
        lam = product / (design.resistance or DEFAULT_RESISTANCE)
    if isinstance(lam, str) or not SMALL <= lam <= LARGE:
        text = f"the problem needs a number between {SMALL:g} and {LARGE:g} for lambda"
        raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
    return IdealNetwork(
        T=problem.matrix,
        eps=problem.strain,
        lam=lam,
        RC=product / lam * design.capacitance,
        U0=design.unit_voltage,
        amplifier=kind,
        Ve=slope,
        bias=is_biased(scene),
        ridge_share=design.ridge_share,
    )


NETWORKS: Mapping[str, AtOnce] = plugins.OpenTable(
    "taction.networks",
    {
        "inv": AtOnce(solve_square),
        "pinv": AtOnce(solve),
        "ridge": AtOnce(solve, regularised=True),
    },
    AtOnce,
)
"""Networks without capacitors by their topologies; all others follow the flow of eq (9)."""


def is_biased(scene: Scene) -> bool:
    """Whether Omega has the term of the bias current, by the scene or by the paper's Omega."""
    bias = scene.design.bias
    return REGULARISERS[scene.design.amplifier].biased if bias is None else bias


def initial_voltages(scene: Scene, network: IdealNetwork) -> Floats:
    """Return v of every signal node when the strain steps on, shape (N,), V.

    SolverError: the scene starts from rest, and the network without strain has no solution.
    """
    if scene.analysis.initial == "zero" or network.amplifier == "linear":
        return np.zeros(network.T.shape[1])
    rest = replace(network, eps=np.zeros_like(network.eps)).rest
    return network.unit * (rest.v if rest.v is not None else rest.u)


def ideal_answer(network: IdealNetwork, scene: Scene) -> IdealAnswer:
    """Solve for the steady state; the transient starts from the initial state of the scene.

    SolverError: the solver can return no answer.
    """
    initial, solution = initial_voltages(scene, network), network.rest
    gain = REGULARISERS[network.amplifier].g
    start, target = network.U0 * gain(initial / network.unit), solution.u * network.U0
    amplitude = float(np.abs(target - start).max()) or 1.0
    return IdealAnswer(
        network=network,
        band=scene.checks.settling_time.band,
        solution=solution,
        start=start,
        target=target,
        error=solution.error_bound * network.U0 / amplitude,
        initial=initial,
        problem=solution.reason,
    )
