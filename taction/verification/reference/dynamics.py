"""The ideal network and its transient: modes for linear amplifiers, Radau for all others.

``C dv/dt = -v/R - I_b - s G0 T^T (G0 T u - G0 U0 eps)``, ``u = U0 g(v/Ve)`` (eq 9 as corrected). In
``x = v/Ve`` and ``t/(R C)`` this is ``dx = -(x + beta) - T^T (T g(x) - eps) / mu``: of all its
components only mu, a multiple of lambda, is left. Its rest state solves the reference problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.system.reading_definitions import SETTLING_BAND
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS, Regulariser
from taction.verification.reference.solve import solve, solve_square


@dataclass(frozen=True, slots=True)
class AtOnce:
    """A network without capacitors: with ideal op-amps it is at rest at once."""

    solver: Callable[[Problem], Solution]  # solves the problem of its rest
    regularised: bool = False  # whether lambda stands in it; else it is 0


AT_ONCE = {
    "inv": AtOnce(solve_square),
    "pinv": AtOnce(solve),
    "ridge": AtOnce(solve, regularised=True),
}
"""Networks without capacitors by the names of their topologies; they see only the problem."""


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


PIECES, ROUNDS = 64, 10  # of an interval in each round of a search: 60 halvings


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

        def last_outside(time: Floats) -> int:
            away = np.max(np.abs(self.outputs(time) - self.target), axis=1)
            return int(np.flatnonzero(away > limit)[-1]) if np.any(away > limit) else -1

        last = last_outside(self.time)
        if limit == 0.0 or last < 0:
            return 0.0
        if last == len(self.time) - 1:
            return float("inf")
        begin, end = self.time[last], self.time[last + 1]
        for _ in range(ROUNDS):  # the ends are known; anew they may round to the other side
            time = np.linspace(begin, end, PIECES + 1)
            last = last_outside(time[1:-1]) + 1
            begin, end = time[last], time[last + 1]
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
