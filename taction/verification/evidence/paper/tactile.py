"""The paper's simulated problem: cylinder load (18), kernel (19), white noise on the strain.

The paper prints neither the number of channels nor the range of y, so there are two geometries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.inverse_problem import cylinder_stress, grid, kernel
from taction.netlist_gen.scene.problem_keys import CylinderLoad
from taction.system.array_types import Floats
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve

VARIANCE = 0.1


@dataclass(frozen=True, slots=True)
class Geometry:
    """A grid of `channels` points over `span` depths, at depth 1."""

    channels: int
    span: float

    @property
    def y(self) -> Floats:
        """Positions (N,)."""
        return grid(self.channels, self.span)

    @property
    def spacing(self) -> float:
        """Distance of neighbours over the depth."""
        return self.span / (self.channels - 1)

    @property
    def matrix(self) -> Floats:
        """Matrix (N, N) of eq (19), without weights, as the paper prints eq (4)."""
        return kernel(self.y[:, None] - self.y[None, :], depth=1.0, modulus=1.0, poisson=0.5)

    @property
    def stress(self) -> Floats:
        """Stress (N,) of eq (18) with p = 3, a = 1."""
        return cylinder_stress(self.y, CylinderLoad())

    def strain(self, seed: int, variance: float = VARIANCE) -> Floats:
        """Return the strain (N,) with noise."""
        clean = self.matrix @ self.stress
        noise = np.random.default_rng(seed).normal(0.0, np.sqrt(variance), clean.shape)
        return np.asarray(clean + noise)


COARSE = Geometry(21, 16.0)
FINE = Geometry(51, 6.0)


def entropy(T: Floats, strain: Floats, lam: float) -> Floats:
    """Return the minimiser (N,) of eq (8)."""
    return solve(Problem(T, strain, lam, "exponential", True)).u


def unit_network(
    T: Floats, strain: Floats, mu: float, amplifier: str = "exponential"
) -> IdealNetwork:
    """Return the ideal network with unit U0 and Ve whose times count in R C.

    `mu` is ``1 / (s R)``: lambda for linear amplifiers, half of lambda for exponential ones.
    """
    regulariser = REGULARISERS[amplifier]
    lam = mu / regulariser.weight
    return IdealNetwork(T, strain, lam, RC=1.0, amplifier=amplifier, bias=regulariser.biased)


def difference(a: Floats, b: Floats) -> float:
    """Return the largest difference of two arrays over the largest entry of the second."""
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def by_transform(geometry: Geometry, strain: Floats) -> Floats:
    """Deconvolve (..., N) by the discrete Fourier transform: divide by the kernel's spectrum."""
    N = geometry.channels
    offset = np.asarray(geometry.spacing * np.fft.fftfreq(N, 1.0 / N), dtype=np.float64)
    spectrum = np.fft.fft(kernel(offset, depth=1.0, modulus=1.0, poisson=0.5))
    return np.asarray(np.fft.ifft(np.fft.fft(strain) / spectrum).real)


def gradient_flow(T: Floats, time: float, strain: Floats) -> Floats:
    """Return the outputs (..., N) of ``du/dt = -Tᵀ(Tu - eps)`` from zero, exact in the modes of T.

    `time` is in time constants of the fastest mode, and infinity is the rest.
    """
    U, sigma, Vt = np.linalg.svd(T)
    share = -np.expm1(-((sigma / sigma[0]) ** 2) * time) / sigma
    return np.asarray((strain @ U * share) @ Vt)
