"""The ideal network and its transient: exact modes for linear amplifiers, Radau for all others.

``C dv/dt = -v/R - I_b - s G0 T^T (G0 T u - G0 U0 eps)``, ``u = U0 g(v/Ve)`` (eq 9 as corrected). In
``x = v/Ve`` and ``t/(R C)`` this is ``dx = -(x + beta) - T^T (T g(x) - eps) / mu``: of all its
components only mu, a multiple of lambda, is left. Its rest state solves the reference problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from taction.system.array_types import Floats, Indices
from taction.system.reading_definitions import RISE_LEVELS, SETTLING_BAND, SMALL_STEP
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS, Regulariser
from taction.verification.reference.solve import solve


@dataclass(frozen=True, slots=True)
class AtOnce:
    """A network without capacitors: with ideal op-amps it is at rest at once.

    Attributes
    ----------
    solver : callable
        Solves the problem of its rest.
    regularised : bool
        Whether lambda stands in it; else it is 0.
    """

    solver: Callable[[Problem], Solution]
    regularised: bool = False


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

        Raises
        ------
        SolverError
            The solver can return no answer.
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

    Parameters
    ----------
    amplifier : str
        A key of `REGULARISERS`.
    s : float
        Gain of the constraint plane, ohm.
    G0 : float
        Unit conductance, S.
    U0, Ve : float
        Unit voltage and slope of the amplifier, V.
    """
    volts = 1.0 if amplifier == "linear" else Ve / U0
    return volts / REGULARISERS[amplifier].weight / G0 / G0 / s


HALVINGS = 24  # of a step in which a piecewise linear amplifier changes its piece
SECTIONS, ROUNDS = 64, 9  # 64^9 is 2^54: an interval is divided down to its rounding


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
        """Return the last instant at which any channel is outside the band around its target.

        Parameters
        ----------
        band : float
            Half-width over the step amplitude.

        Returns
        -------
        float
            s; 0 if no channel moves; infinite if the record ends outside the band.
        """
        limit = band * self.amplitude
        outside = np.max(np.abs(self.outputs(self.time) - self.target), axis=1) > limit
        if limit == 0.0 or not outside.any():
            return 0.0
        last = int(np.flatnonzero(outside)[-1])
        if last == len(self.time) - 1:
            return float("inf")

        def excess(t: Floats) -> Floats:
            return np.asarray(limit - np.max(np.abs(self.outputs(t) - self.target), axis=1))

        return _root(excess, float(self.time[last]), float(self.time[last + 1]))

    def rise_times(self, *channels: int) -> Floats:
        """Return the time from 10 to 90 % of a channel's own step, first crossings.

        Parameters
        ----------
        *channels : int
            From 0; without them every channel.

        Returns
        -------
        ndarray (K,)
            One time for each of the K channels, s; not a number where the step is under 5 % of the
            step amplitude or the record ends before 90 %.
        """
        low, high = RISE_LEVELS
        asked: Indices = np.array(channels or range(len(self.target)), dtype=np.intp)
        return (self._crossings(high, asked) - self._crossings(low, asked))[asked]

    def _crossings(self, level: float, asked: Indices) -> Floats:
        step = self.target - self.start
        moving = asked[np.abs(step[asked]) >= SMALL_STEP * self.amplitude]
        times = np.full(len(step), np.nan)
        if self.amplitude == 0.0:
            return times
        progress = (self.outputs(self.time)[:, moving] - self.start[moving]) / step[moving]
        above = progress >= level
        for column, n in enumerate(moving.tolist()):
            if not above[:, column].any():
                continue
            first = int(np.argmax(above[:, column]))

            def height(t: Floats, n: int = n) -> Floats:
                return np.asarray((self.outputs(t)[:, n] - self.start[n]) / step[n] - level)

            times[n] = _root(height, float(self.time[max(first - 1, 0)]), float(self.time[first]))
        return times


def _root(f: Callable[[Floats], Floats], low: float, high: float) -> float:
    """Return the first instant in the interval from which `f` is not negative; else `high`.

    Every round evaluates `SECTIONS` instants at once. The import of `scipy.optimize` for its
    `brentq` takes 0.15 s, a fifth of the command `taction verify`.
    """
    for _ in range(ROUNDS):
        times = np.linspace(low, high, SECTIONS + 1)
        reached = f(times) >= 0.0
        k = int(np.argmax(reached)) if reached.any() else SECTIONS
        if k == 0:
            return low
        low, high = float(times[k - 1]), float(times[k])
    return high


TOLERANCE = 1e-10
"""Relative tolerance of both integrators."""
AGREEMENT = 1e-6
"""Largest difference of Radau and LSODA over the step amplitude, and largest energy residual."""
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)


class Trust(Enum):
    """Outcome of a transient; the value explains the outcome to the user."""

    TRUSTED = "two integrators and the energy balance agree"
    DISAGREES = "the integrators or the energy balance disagree: inconclusive"
    NOT_FINITE = "a value overflowed: reduce the strain or the gain"
    FAILED = "the integrator stopped early: the network is too stiff for double precision"


def ideal_linear(network: IdealNetwork, v0: Floats, rest: Solution | None = None) -> Response:
    """Return the exact response of linear amplifiers in modal form.

    Parameters
    ----------
    network : IdealNetwork
        With linear amplifiers.
    v0 : ndarray (N,)
        Signal-node voltages at time 0, V.
    rest : Solution, optional
        Solution of the network's problem, if the caller has it already.

    Returns
    -------
    Response
        ``v(t) = v_inf + sum_i V_i exp(-(1 + sigma_i^2/mu) t/(R C)) V_i . (v0 - v_inf)``.

    Raises
    ------
    ValueError
        The amplifiers are not linear, or the network has no capacitors.
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


@dataclass(frozen=True, slots=True, eq=False)
class IdealTransient:
    """A response with the evidence for its accuracy."""

    response: Response | None  # None if no finite values were computed
    rest: Solution  # the reference steady state, which is the response's target
    outcome: Trust
    energy_residual: float  # see `ScaledNetwork.energy_residual`
    second_opinion: float  # largest difference of Radau and LSODA over the step amplitude
    stiffness: float  # fastest over slowest rate at rest


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

    def energy_residual(self, steps: Floats, dense: Callable[[Floats], Floats]) -> float:
        """Compare the energy lost with the energy dissipated, by Gauss quadrature in each step.

        Parameters
        ----------
        steps : ndarray (P,)
            Instants over R C, close enough for six Gauss points between two.
        dense : callable
            ``t (K,) -> x (N, K)``.

        Returns
        -------
        float
            ``|P(t) - P(0) + integral of sum C g' v'^2|`` over ``|P(0) - P(t)|``: zero for a
            trajectory of the ideal network (the descent proof of theorem 3.1, with the energy
            as a function of u).
        """
        steps = self._divided(steps, dense)
        half = 0.5 * np.diff(steps)
        x = dense((steps[:-1, None] + half[:, None] * (1.0 + _GAUSS_NODES)).ravel())
        power = np.sum(self.g.slope(x) * self.slope(0.0, x) ** 2, axis=0)
        dissipated = float(np.sum(power * np.outer(half, _GAUSS_WEIGHTS).ravel()))
        lost = self.energy(dense(steps[:1])[:, 0]) - self.energy(dense(steps[-1:])[:, 0])
        return abs(dissipated - lost) / abs(lost) if lost != 0.0 else abs(dissipated)

    def _divided(self, steps: Floats, dense: Callable[[Floats], Floats]) -> Floats:
        """Return `steps` with those divided in which a g of straight pieces changes its piece."""
        for _ in range(HALVINGS if self.g.pieces is not None else 0):
            slopes = self.g.slope(dense(steps))
            changed = np.flatnonzero(np.any(slopes[:, 1:] != slopes[:, :-1], axis=0))
            middles = 0.5 * (steps[changed] + steps[changed + 1])
            steps = np.insert(steps, changed + 1, middles)
        return steps

    def stiffness(self, x: Floats) -> float:
        """Return fastest over slowest rate; a similar matrix is symmetric, so rates are real."""
        A = self.T * np.sqrt(self.g.slope(x))
        sigma = np.linalg.svd(A, compute_uv=False) ** 2 / self.mu
        slowest = sigma[-1] if A.shape[0] >= A.shape[1] else 0.0
        return float((1.0 + sigma[0]) / (1.0 + slowest))


def ideal_transient(
    network: IdealNetwork, v0: Floats, stop: float | None = None, rest: Solution | None = None
) -> IdealTransient:
    """Integrate the ideal network with any amplifier.

    Parameters
    ----------
    network : IdealNetwork
        The network.
    v0 : ndarray (N,)
        Signal-node voltages at time 0, V.
    stop : float, optional
        End time, s; by default long enough for the slowest mode to decay by 1e-8.
    rest : Solution, optional
        Solution of the network's problem, if the caller has it already.

    Returns
    -------
    IdealTransient
        Accurate only if its outcome is ``TRUSTED``.

    Raises
    ------
    SolverError
        The steady state cannot be computed.
    """
    scaled, unit = ScaledNetwork(network), network.RC
    rest = solve(network.problem) if rest is None else rest
    x0 = np.asarray(v0, dtype=np.float64) / network.unit
    at_rest = rest.u if rest.v is None else rest.v
    end = np.log(1e8 * (1.0 + np.max(np.abs(x0 - at_rest)))) if stop is None else stop / unit
    stiffness = scaled.stiffness(at_rest)
    with np.errstate(all="ignore"):
        run = _integrate(scaled, x0, float(end))
        if isinstance(run, Trust):
            return IdealTransient(None, rest, run, np.nan, np.nan, stiffness)
        steps, dense = run
        residual = scaled.energy_residual(steps, dense)
        difference = _difference_to_lsoda(scaled, x0, steps, dense)

    def outputs(t: Floats) -> Floats:
        return np.asarray(network.U0 * scaled.g.g(dense(np.asarray(t) / unit)).T)

    inner = np.linspace(0.0, 1.0, 8, endpoint=False)
    grid = (steps[:-1, None] + np.diff(steps)[:, None] * inner).ravel()
    time = np.append(grid, steps[-1]) * unit
    response = Response(time, outputs, network.U0 * scaled.g.g(x0), network.U0 * rest.u)
    amplitude = response.amplitude
    second_opinion = difference * network.U0 / amplitude if amplitude > 0.0 else 0.0
    trusted = rest.trusted and residual <= AGREEMENT and second_opinion <= AGREEMENT
    outcome = Trust.TRUSTED if trusted else Trust.DISAGREES
    return IdealTransient(response, rest, outcome, residual, second_opinion, stiffness)


def _solve_ivp(scaled: ScaledNetwork, x0: Floats, end: float, **options: Any) -> Any:
    from scipy.integrate import solve_ivp

    options |= {"jac": scaled.jacobian, "rtol": TOLERANCE, "atol": TOLERANCE}
    return solve_ivp(scaled.slope, (0.0, end), x0, **options)


def _integrate(
    scaled: ScaledNetwork, x0: Floats, end: float
) -> Trust | tuple[Floats, Callable[[Floats], Floats]]:
    """Run Radau; return its steps (P,) and interpolant ``t -> x (N, K)``, or its failure."""
    if not np.all(np.isfinite(scaled.slope(0.0, x0))):
        return Trust.NOT_FINITE
    run = _solve_ivp(scaled, x0, end, method="Radau", dense_output=True)
    if not np.all(np.isfinite(run.y)):
        return Trust.NOT_FINITE
    if not run.success or run.sol is None:
        return Trust.FAILED
    return np.asarray(run.t), run.sol


def _difference_to_lsoda(
    scaled: ScaledNetwork, x0: Floats, steps: Floats, dense: Callable[[Floats], Floats]
) -> float:
    """Return the largest difference of the outputs to LSODA; infinite if LSODA fails."""
    run = _solve_ivp(scaled, x0, steps[-1], method="LSODA", t_eval=steps)
    if not run.success or run.y.shape[1] != len(steps):
        return float("inf")
    difference = np.max(np.abs(scaled.g.g(run.y) - scaled.g.g(dense(steps))))
    # LSODA sometimes reports success with values that are not numbers.
    return float(difference) if np.isfinite(difference) else float("inf")
