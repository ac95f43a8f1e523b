"""Trajectories of the ideal network: by modes for linear amplifiers, by Radau for all others."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.system.reading_definitions import SETTLING_BAND
from taction.verification.reference.ideal_answer import IdealAnswer, IdealNetwork
from taction.verification.reference.regularisers import REGULARISERS, Regulariser

TOLERANCE = 1e-10  # relative tolerance of the integrator
INSTANTS = 2000  # of a record at which its energy is found
DECAYED = 1e8  # times: by so much the slowest mode decays in a trajectory


def linear_outputs(network: IdealNetwork) -> tuple[Floats, Floats]:
    """Return instants (P,), s, and the exact outputs (P, N), V, of linear amplifiers from zero.

    It is ``v(t) = v_inf - sum_i V_i exp(-(1 + sigma_i^2/mu) t/(R C)) V_i . v_inf``.
    """
    M, N = network.T.shape
    _, sigma, Vt = np.linalg.svd(network.T, full_matrices=M < N)
    rates = np.ones(N)
    rates[: len(sigma)] += sigma**2 / network.mu
    rates /= network.RC
    target = network.rest.u * network.U0
    time = np.append(0.0, np.geomspace(1e-3 / rates.max(), 40.0 / rates.min(), 4000))
    return time, np.asarray(target - (np.exp(-np.outer(time, rates)) * (Vt @ target)) @ Vt)


def settling_time(time: Floats, outputs: Floats, band: float = SETTLING_BAND) -> float:
    """Return the last instant at which any of the outputs (P, N) is outside the band.

    The band is around the last outputs, `band` times the largest step; 0 if none moves.
    """
    away = np.abs(outputs - outputs[-1]).max(axis=1)
    limit = band * float(away[0])
    outside = np.flatnonzero(away > limit)
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    share = (away[last] - limit) / (away[last] - away[last + 1])
    return float(time[last] + share * (time[last + 1] - time[last]))


def ideal_record(answer: IdealAnswer) -> tuple[Floats, Floats]:
    """Return instants (P,), s, and outputs (P, N), V, of the ideal network from its start to rest.

    SolverError: as `ScaledNetwork.trajectory`.
    """
    network = answer.network
    if network.amplifier == "linear":
        return linear_outputs(network)
    scaled = ScaledNetwork(network)
    run = scaled.trajectory(scaled.g.inverse(answer.start / network.U0))
    time = np.append(0.0, np.geomspace(1e-6 * run.t_max, run.t_max, 4000))
    return network.RC * time, np.asarray(network.U0 * scaled.g.g(run(time).T))


def energy_rise(network: IdealNetwork, time: Floats, u: Floats) -> tuple[float, float] | None:
    """Return by how much the energy of outputs `u` (P, N), V, rises at most above its least so far.

    It is a share of the whole fall, beside its instant, s. None: the energy never falls, or an
    output leaves the range of its amplifier, where there is none.
    """
    scaled, every = ScaledNetwork(network), max(len(time) // INSTANTS, 1)
    with np.errstate(all="ignore"):
        x = scaled.g.inverse(u[::every] / network.U0)
        energy = np.array([scaled.energy(row) for row in x])
    fall, above = energy[0] - energy.min(), energy - np.minimum.accumulate(energy)
    if not (np.isfinite(energy).all() and fall > 0.0):
        return None
    peak = int(np.argmax(above))
    return float(above[peak] / fall), float(time[::every][peak])


class ScaledNetwork:
    """Right-hand side, Jacobian and energy in x and ``t/(R C)``, for any integrator."""

    def __init__(self, network: IdealNetwork) -> None:
        self.network = network
        self.T, self.eps, self.mu = network.T, network.eps, network.mu
        self.beta, self.removed = float(network.bias), 1.0 - network.ridge_share
        self.g: Regulariser = REGULARISERS[network.amplifier]
        self.gram = self.T.T @ self.T / self.mu

    @cached_property
    def rest(self) -> Floats:
        """The state (N,) at rest."""
        found = self.network.rest
        return found.u if found.v is None else found.v

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

    def trajectory(self, x0: Floats) -> Any:
        """Return the dense solution, x (N, K) of times (K,), from x0 until it is at rest.

        SolverError: a value overflows, or the network is too stiff for double precision.
        """
        from scipy.integrate import solve_ivp

        end = float(np.log(DECAYED * (1.0 + np.max(np.abs(x0 - self.rest)))))
        with np.errstate(all="ignore"):
            if np.isfinite(self.slope(0.0, x0)).all():
                run: Any = solve_ivp(
                    self.slope, (0.0, end), x0, "Radau", dense_output=True,
                    jac=self.jacobian, rtol=TOLERANCE, atol=TOLERANCE,
                )  # fmt: skip
                if run.success and np.isfinite(run.y).all():
                    return run.sol
        raise SolverError("the ideal network is too stiff for double precision")
