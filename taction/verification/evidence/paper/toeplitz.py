"""Solver for Toeplitz problems of up to a million channels; T is never formed.

A kernel that depends only on the distance makes T Toeplitz on an even grid. `newton` has the outer
iteration, its homotopy and its gap. The Newton matrix ``mu I + D T^T T D`` is preconditioned by
circulants, each for one value of D^2 and interpolated between: a single circulant leaves channels
with a small D badly scaled. Two digits a step are enough, so the solver works in single precision
if the condition number allows.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Floats
from taction.verification.reference.newton import (
    Iterate,
    NewtonResult,
    System,
    error_bound,
    homotopy,
    largest_ratio,
    newton,
)
from taction.verification.reference.problem import SMALLEST_SCALE, Solution, ToeplitzProblem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.stacked_least_squares import StackedFactor

Real = NDArray[Any]
"""Single or double precision."""

INNER_TOLERANCE = 1e-2
INNER_STEPS = 500
SINGLE_CONDITION = 1e5
"""Largest condition number of the Newton matrix for single precision in the inner solver."""
BLENDS = 3
"""Circulants in the preconditioner."""


class ToeplitzMatrix:
    """A square Toeplitz matrix from its first `column` and `row` (N,), whose first entries agree.

    `norm` is that of a circulant that contains T: an upper bound on the spectral norm of T.
    """

    def __init__(self, column: Floats, row: Floats) -> None:
        from scipy import fft

        self.size = len(column)
        self._length = fft.next_fast_len(2 * self.size - 1, real=True)
        ring = np.zeros(self._length)
        ring[: self.size] = column
        if self.size > 1:
            ring[1 - self.size :] = row[:0:-1]
        self._spectrum = np.asarray(fft.rfft(ring))
        self._single = self._spectrum.astype(np.complex64)
        self.norm = float(np.max(np.abs(self._spectrum)))
        self.rounding = 4.0 * EPS * float(np.sqrt(np.log2(self._length + 1)))
        """Rounding error of a product over ``norm |x|``: sqrt(log N) for a fast transform."""

    def product(self, u: Real) -> Real:
        """Return ``T u`` for u (N,), in the precision of u."""
        return self._convolve(u, conjugate=False)

    def transposed(self, r: Real) -> Real:
        """Return ``T^T r`` for r (N,), in the precision of r."""
        return self._convolve(r, conjugate=True)

    def _convolve(self, x: Real, conjugate: bool) -> Real:
        from scipy import fft

        image = np.asarray(fft.rfft(x, self._length))
        spectrum = self._single if image.dtype == np.complex64 else self._spectrum
        image *= np.conj(spectrum) if conjugate else spectrum
        return np.asarray(fft.irfft(image, self._length, overwrite_x=True)[: self.size])


def circulant_power(column: Floats, row: Floats) -> Floats:
    """Return the squared spectrum of the circulant nearest to T (T. Chan), (N // 2 + 1,)."""
    from scipy import fft

    size = len(column)
    share = np.arange(size) / size
    wrapped = np.concatenate([[0.0], row[:0:-1]])
    return np.asarray(np.abs(fft.rfft((1.0 - share) * column + share * wrapped)) ** 2)


class ConjugateGradients:
    """Solver of ``(mu I + D T^T T D) y = D T^T f1 + f2`` to two digits."""

    def __init__(self, T: ToeplitzMatrix, power: Floats, D: Floats, mu: float) -> None:
        self._T, self._D, self._mu = T, D, mu
        square = D * D
        top, peak_power = float(np.max(square)), float(np.max(power))
        single = top * T.norm**2 <= SINGLE_CONDITION * mu
        self._type: np.dtype[Any] = np.dtype(np.float32 if single else np.float64)
        coupled = 0.3 * mu / peak_power if peak_power > 0.0 else top
        least = max(float(np.min(square)), coupled, 1e-300)
        low, high = np.log(least), np.log(max(top, least))
        nodes = np.linspace(low, high, BLENDS) if high - low > 0.1 else np.array([high])
        place = np.zeros_like(D)
        if len(nodes) > 1:
            place = (np.log(np.maximum(square, least)) - low) / (nodes[1] - nodes[0])
        apart = np.abs(place - np.arange(len(nodes))[:, None])
        self._weights: Real = np.sqrt(np.maximum(1.0 - apart, 0.0)).astype(self._type)
        self._inverses: Real = (mu / (mu + np.outer(np.exp(nodes), power))).astype(self._type)

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        """Return y (N,) for f1 and f2 (N,)."""
        b = self._D * self._T.transposed(f1) + f2
        size = float(np.linalg.norm(b))
        if size == 0.0:
            return b
        D: Real = self._D.astype(self._type)
        mu = self._type.type(self._mu)
        y: Real = np.zeros_like(D)
        r: Real = (b / size).astype(self._type)
        z = self._preconditioned(r)
        p, rho = z, float(r @ z)
        target = INNER_TOLERANCE**2 * rho
        for _ in range(INNER_STEPS):
            q = D * self._T.transposed(self._T.product(D * p)) + mu * p
            curvature = float(p @ q)
            if not curvature > 0.0:
                break
            step = self._type.type(rho / curvature)
            y += step * p
            r -= step * q
            z = self._preconditioned(r)
            rho, before = float(r @ z), rho
            if not rho > target:
                break
            p = z + self._type.type(rho / before) * p
        return np.asarray(y.astype(np.float64) * size)

    def _preconditioned(self, r: Real) -> Real:
        from scipy import fft

        images: Real = np.asarray(fft.rfft(self._weights * r, axis=1, workers=2))
        images *= self._inverses
        back: Real = fft.irfft(images, len(r), axis=1, workers=2, overwrite_x=True)
        return np.asarray(np.sum(self._weights * back, axis=0))


class Levinson:
    """Solver of ``(T^2 + mu) y = T f1 + f2`` for symmetric T, by one complex Toeplitz system.

    ``(T + i sqrt(mu))^-1 = (T - i sqrt(mu)) (T^2 + mu)^-1``: real and imaginary part.
    """

    def __init__(self, column: Floats, mu: float) -> None:
        self._root = np.sqrt(mu)
        self._column = column.astype(complex)
        self._column[0] += 1j * self._root

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        """Return y (N,) for f1 and f2 (N,)."""
        from scipy.linalg import solve_toeplitz

        both = np.stack([f1, f2], axis=1)
        x = solve_toeplitz((self._column, self._column), both)
        return np.asarray(x[:, 0].real - x[:, 1].imag / self._root)


TOLERANCE = 1e-6
"""Default error of u over its largest entry below which a solution is trusted."""
LEVINSON_SIZE = 8192
"""Largest size at which Levinson's recursion solves symmetric linear problems."""


@dataclass(frozen=True, slots=True, eq=False)
class _ToeplitzSystem(System):
    """A scaled Toeplitz problem."""

    T: ToeplitzMatrix
    column: Floats  # of T (N,)
    power: Floats  # see `circulant_power`
    symmetric: bool

    @classmethod
    def of(cls, problem: ToeplitzProblem) -> _ToeplitzSystem:
        norm = ToeplitzMatrix(problem.column, problem.row).norm
        scale = float(2.0 ** np.rint(np.log2(norm))) if norm > 0.0 else 1.0
        column, row = problem.column / scale, problem.row / scale
        above, below = np.cumsum(row**2), np.cumsum(column**2)
        h = above + below[::-1] - column[0] ** 2  # the diagonal entry is in both sums
        regulariser, T = REGULARISERS[problem.regulariser], ToeplitzMatrix(column, row)
        return cls(
            eps=problem.eps / scale,
            mu=regulariser.weight * problem.lam / scale / scale,
            beta=float(problem.bias),
            scale=scale,
            norm=T.norm,
            h=np.maximum(h, max(1e-30 * float(np.max(h)), float(np.finfo(float).tiny))),
            regulariser=regulariser,
            T=T,
            column=column,
            power=circulant_power(column, row),
            symmetric=bool(np.array_equal(column, row)),
        )

    def product(self, u: Floats) -> Floats:
        return self.T.product(u)

    def transposed(self, r: Floats) -> Floats:
        return self.T.transposed(r)

    def factor(self, D: Floats, mu: float) -> StackedFactor:
        linear = self.regulariser is REGULARISERS["linear"]
        if linear and self.symmetric and self.T.size <= LEVINSON_SIZE:
            return Levinson(self.column, mu)
        return ConjugateGradients(self.T, self.power, D, mu)


def _gap(s: _ToeplitzSystem, result: NewtonResult) -> float:
    """Evaluate the gap, with a bound on its rounding error added."""
    v, size = result.primal.v, float(np.linalg.norm(result.primal.u))
    dual, strain = float(np.linalg.norm(result.dual)), float(np.linalg.norm(s.eps))
    misfit = float(np.linalg.norm(result.primal.residual - result.dual))
    misfit += s.T.rounding * (s.norm * size + strain + dual)
    d = np.abs(s.transposed(result.dual) - s.mu * (v + s.beta)) / s.mu
    d += EPS * np.abs(v)
    rounding = s.T.rounding * s.norm * dual / s.mu  # norm of the rounding error of d
    with np.errstate(over="ignore", invalid="ignore"):
        slope = s.regulariser.largest_slope(v, d + rounding)
        apart = float(np.sum(slope * d * d)) + float(np.max(slope)) * rounding * rounding
    gap = 0.5 * misfit * misfit + s.mu * apart  # (d + e)^2 / 2 <= d^2 + e^2
    return gap if np.isfinite(gap) else float("inf")


def solve_toeplitz_problem(problem: ToeplitzProblem, tolerance: float = TOLERANCE) -> Solution:
    """Solve a Toeplitz problem of any size.

    Parameters
    ----------
    problem : ToeplitzProblem
        The problem.
    tolerance : float
        Error over the largest entry of u at which to stop, and below which u is trusted.

    Returns
    -------
    Solution
        Certificate: duality gap, with the rounding of the transforms added to it.
    """
    start = time.perf_counter()
    s = _ToeplitzSystem.of(problem)
    reg = s.regulariser

    def allowed(u: Floats) -> tuple[float, float]:
        peak = float(np.max(np.abs(u)))
        return tolerance * max(peak, SMALLEST_SCALE), float(np.max(reg.slope_bound(u)))

    def target_ratio(u: Floats) -> float:
        return 0.1 * largest_ratio(*allowed(u))

    if problem.regulariser == "linear":
        result = newton(s, s.mu, Iterate.at(s, np.zeros(len(s.h)), s.mu), target_ratio)
    else:
        result = homotopy(s, target_ratio)
    last = result.primal
    gap, (limit, slope_bound) = _gap(s, result), allowed(last.u)
    in_units = 2.0 * s.scale**2
    certificate, bound = in_units * gap, in_units * s.mu * largest_ratio(limit, slope_bound)
    trusted = certificate <= bound
    return Solution(
        problem=problem,
        u=last.u,
        v=None if problem.regulariser == "linear" else last.v,
        objective=in_units * last.objective,
        certificate_kind="duality gap",
        certificate=certificate,
        bound=bound,
        error_bound=error_bound(gap / s.mu, slope_bound),
        trusted=trusted,
        condition=float(np.sqrt(1.0 + s.norm**2 * float(np.max(reg.slope(last.v))) / s.mu)),
        iterations=result.steps,
        seconds=time.perf_counter() - start,
        reason=""
        if trusted
        else (
            f"the duality gap {certificate!r} is above {bound!r}, the limit for a relative error of"
            f" {tolerance!r}; use a larger lambda or a larger tolerance"
        ),
    )
