"""Radau IIA collocation of any odd number of stages for ``M z' = F(z)``, adaptive, dense output.

With s stages the order is 2s - 1, L-stable and stiffly accurate, so M may be singular (index 1).
The stage equations are solved by simplified Newton in the eigenbasis of the inverse of the
method's matrix: one real and (s - 1)/2 complex systems a factorisation (Hairer and Wanner, Solving
Ordinary Differential Equations II, sections IV.8 and IV.10). The embedded error estimate has order
s, as has the dense output, the collocation polynomial itself.

The effect of rounding is measured: F is computed at points that differ from z by rounding only, and
the differences, with independent signs in every row, are solved for as F is. A Newton correction
or an error estimate that is smaller than this effect counts as zero.

The coefficients are computed in the basis that decouples the stages (sections IV.5 and IV.8).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Complexes, Floats
from taction.system.errors import EngineError


@dataclass(frozen=True, slots=True, eq=False)
class Tableau:
    """One method, in the basis that decouples its stages.

    `c` (s,) are the collocation points, the last of which is 1; `shifts` ((s + 1) / 2,) the
    eigenvalues of the inverse of the method's matrix: the real one, then one of each pair. `left`
    and `right` transform: ``W = left Z``, ``Z = Re(right W)``. The error estimate is
    ``(shift0 M / h - F')^-1 (F(z0) + M estimate Z / h)``, and ``Q = Z^T polynomial`` are the
    coefficients of theta, theta², ...
    """

    c: Floats
    shifts: Complexes
    left: Complexes
    right: Complexes
    estimate: Floats
    polynomial: Floats


@cache
def tableau(stages: int) -> Tableau:
    """Compute the Radau IIA method with `stages` stages (odd)."""
    from numpy.polynomial.legendre import Legendre

    first, second = Legendre.basis(stages), Legendre.basis(stages - 1)
    c = 0.5 * (np.sort((first - second).roots().real) + 1.0)
    c[-1] = 1.0
    k = np.arange(1, stages + 1)
    powers = c[:, None] ** k  # of the collocation polynomial's terms
    inverse = (k * c[:, None] ** (k - 1)) @ np.linalg.inv(powers)  # of the method's matrix
    values, vectors = np.linalg.eig(inverse)
    kept = np.flatnonzero(values.imag >= 0.0)
    kept = kept[np.argsort(values[kept].imag)]
    weight = np.where(values[kept].imag > 0.0, 2.0, 1.0)
    unit = np.zeros(stages)
    unit[0] = -1.0
    embedded = np.linalg.solve(c ** (k - 1)[:, None], unit)  # (b_hat - b) / gamma
    return Tableau(
        c=c,
        shifts=values[kept].astype(np.complex128),
        left=np.linalg.inv(vectors)[kept].astype(np.complex128),
        right=(vectors[:, kept] * weight).astype(np.complex128),
        estimate=np.asarray(embedded @ inverse),
        polynomial=np.linalg.inv(powers).T.astype(np.float64),
    )


Solve = Callable[[Complexes], Complexes]

STAGES = 5
NEWTON_STEPS = 8
SHRINK, GROW, SAFETY = 0.2, 8.0, 0.9
KEEP = 1.3  # a step is not lengthened by less than this: it would cost new factorisations
SPREAD = 4.0  # standard deviations of the rounding that still count as rounding
SHORTEST = 1e-15  # of the time: a step that floats no longer add to the time


class System(Protocol):
    """``M z' = F(z)``; arrays of shape (size,) or, for several z at once, (size, s)."""

    size: int

    def rate(self, z: Floats) -> Floats:
        """Evaluate F; not finite where z is beyond the range of floats."""
        ...

    def mass(self, z: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Return M z."""
        ...

    def factor(self, z: Floats, shifts: Complexes) -> list[Solve]:
        """Return solvers of ``(shift M - F'(z)) x = r``; the first shift is real."""
        ...

    def watch(self, z: Floats) -> Floats:
        """Return the linear combinations of z in the dense output; shape (W,) or (W, s)."""
        ...


@dataclass(slots=True, eq=False)
class Dense:
    """Dense output of the watched values: a polynomial in every step.

    Attributes
    ----------
    ends : list of float
        0 and the end of every step, s.
    pieces : list of ndarray (W, s + 1)
        Coefficients of theta = 0 .. 1 over a step.
    steps, rejected, factorisations : int
        What it cost.
    escaped : bool
        Whether it ended early because an unknown passed its limit.
    rounding : float
        What rounding, and steps too short to be halved, left, added up over the steps, V.
    coarse : bool
        Whether that was above the tolerance in a step.
    """

    ends: list[float]
    pieces: list[Floats]
    steps: int = 0
    rejected: int = 0
    factorisations: int = 0
    escaped: bool = False
    rounding: float = 0.0
    coarse: bool = False

    def at(self, times: Floats) -> Floats:
        """Watched values at `times`, shape (P, W)."""
        ends = np.array(self.ends)
        which = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, len(self.pieces) - 1)
        theta = (times - ends[which]) / (ends[which + 1] - ends[which])
        steps, place = np.unique(which, return_inverse=True)
        pieces = np.stack([self.pieces[k] for k in steps.tolist()])[place]
        powers = theta[:, None] ** np.arange(pieces.shape[2])
        return np.asarray(np.einsum("pws,ps->pw", pieces, powers))


class Rounding(NamedTuple):
    """Rounding of a Newton correction and of the error estimate, in tolerances; the latter in V."""

    stages: float = 0.0
    estimate: float = 0.0
    volts: float = 0.0


class Radau:
    """Integrator of one system from t = 0.

    Parameters
    ----------
    system : System
        The equations.
    z : ndarray (size,)
        Consistent initial value.
    relative : float
        Relative tolerance of a step.
    floor : ndarray (size,)
        Least magnitude of each unknown for its relative error.
    first_step : float
        s.
    limit : float
        Magnitude of any unknown at which the integration ends early (`Dense.escaped`).
    """

    def __init__(
        self,
        system: System,
        z: Floats,
        relative: float,
        floor: Floats,
        first_step: float,
        limit: float = math.inf,
    ) -> None:
        self.system, self.z, self.t, self.h = system, z, 0.0, first_step
        self.relative, self.floor, self.limit = relative, floor, limit
        self.table = tableau(STAGES)
        self.newton_tolerance = max(1e-14 / relative, min(0.03, math.sqrt(relative)))
        self.solvers: list[Solve] = []  # empty: to be made
        self.fresh = False  # whether the Jacobian is that of the present z
        self.rounding = Rounding()
        self.signs = np.random.default_rng(1992).standard_normal((2, system.size, STAGES))
        self.polynomial: Floats | None = None
        self.last_step = first_step
        self.out = Dense([0.0], [])

    def run(self, stop: float, max_steps: int = 1_000_000) -> Dense:
        """Integrate to `stop`, s, or until an unknown passes the limit.

        Raises
        ------
        EngineError
            The solution leaves the range of floats, or the step underflows.
        """
        self.stop = stop
        while self.t < stop * (1.0 - 1e-14) and not self.out.escaped:
            self._advance()
            if self.out.steps > max_steps:
                raise EngineError(f"{max_steps} steps did not reach {stop!r} s (now {self.t!r} s)")
        return self.out

    def _advance(self) -> None:
        """Take one accepted step."""
        rate = self.system.rate(self.z)
        if not np.all(np.isfinite(rate)):
            raise EngineError(f"an amplifier left the range of floats at {self.t!r} s")
        while True:
            left = self.stop - self.t
            # Two equal last steps instead of a long and a tiny one.
            wanted = left if self.h > 0.99 * left else min(self.h, 0.5 * left)
            if wanted != self.h:
                self.h, self.solvers = wanted, []
            if self._attempt(rate):
                return

    def _attempt(self, rate: Floats) -> bool:
        """Try a step of h; on failure choose another h (or Jacobian) and return False."""
        if not self.solvers:
            self.solvers = self.system.factor(self.z, self.table.shifts / self.h)
            self.out.factorisations += len(self.table.shifts)
            self.rounding = self._rounding(rate)
            self.fresh = True
        shortest = self.h < SHORTEST * self.stop
        found = self._newton()
        if found is None:
            if self.fresh and shortest:
                raise EngineError(f"the time step fell below {self.h:.3g} s at {self.t!r} s")
            self.h *= 0.5 if self.fresh else 1.0
            self.solvers = []
            self.out.rejected += 1
            return False
        Z, contraction = found
        floor = self.rounding.estimate
        error = max(self._error(rate, Z) - floor, 0.0) / max(floor, 1.0)
        factor = SAFETY * error ** (-1.0 / (STAGES + 1)) if error > 0.0 else GROW
        factor = min(max(factor, SHRINK), GROW)
        if error > 1.0 and not shortest:
            self.h *= min(factor, SAFETY)
            self.solvers = []
            self.out.rejected += 1
            return False
        left = error * float(self._scale(self.z).max()) if error > 1.0 else 0.0
        self.out.rounding += self.rounding.volts + left
        self.out.coarse |= max(floor, error) > 1.0
        self._accept(Z)
        self.fresh = False
        if factor > KEEP:
            self.h *= factor
            self.solvers = []
        elif contraction > 0.05:
            self.solvers = []  # a new Jacobian is cheaper than slow Newton steps
        return True

    def _scale(self, z: Floats) -> Floats:
        return self.relative * np.maximum(np.abs(z), self.floor)

    def _norm(self, x: Floats, scale: Floats) -> float:
        with np.errstate(over="ignore"):  # Newton's method may go anywhere before it is stopped
            return float(np.sqrt(np.mean((x / scale) ** 2)))

    def _rounding(self, rate: Floats) -> Rounding:
        """Measure what rounding at the present z makes of a Newton correction and an estimate."""
        near, signs = self.signs
        scatter = self.system.rate(self.z[:, None] * (1.0 + EPS * near)) - rate[:, None]
        if not np.all(np.isfinite(scatter)):
            return Rounding()
        size = np.sqrt(np.mean(scatter**2, axis=1)) + EPS * np.abs(rate)
        noise = SPREAD * size[:, None] * signs
        dZ = (self.table.right @ self._solve(self.table.left @ noise.T)).real.T
        pull = np.asarray(self.system.mass(dZ @ self.table.estimate).real) / self.h
        error = self.solvers[0]((noise[:, 0] + pull).astype(np.complex128)).real
        scale, volts = self._scale(self.z), float(np.abs(error).max())
        return Rounding(self._norm(dZ, scale[:, None]), self._norm(error, scale), volts)

    def _solve(self, residual: Complexes) -> Complexes:
        """Solve the decoupled stage equations, shape (k, size)."""
        return np.stack([solve(r) for solve, r in zip(self.solvers, residual, strict=True)])

    def _newton(self) -> tuple[Floats, float] | None:
        """Solve the stage equations; None if Newton's method does not contract."""
        table, system, h = self.table, self.system, self.h
        Z = self._guess()
        W = table.left @ Z.T.astype(np.complex128)  # (k, size)
        scale, before, contraction = self._scale(self.z), math.inf, 0.0
        enough = max(self.newton_tolerance, self.rounding.stages)
        for step in range(NEWTON_STEPS):
            F = system.rate(self.z[:, None] + Z)
            if not np.all(np.isfinite(F)):
                return None
            dW = self._solve(table.left @ F.T - (table.shifts[:, None] / h) * system.mass(W.T).T)
            W = W + dW
            dZ = (table.right @ dW).real.T
            Z = (table.right @ W).real.T
            size = self._norm(dZ, scale[:, None])
            if not math.isfinite(size):
                return None
            if size <= self.rounding.stages:
                return Z, contraction
            if step > 0:
                contraction = size / before
                if contraction >= 1.0:
                    return None
                left = contraction / (1.0 - contraction) * size
                if left < enough:
                    return Z, contraction
                if contraction ** (NEWTON_STEPS - 2 - step) * left > enough:
                    return None
            before = size
        return None

    def _guess(self) -> Floats:
        """Extrapolate the last step's polynomial, shape (size, s)."""
        if self.polynomial is None:
            return np.zeros((self.system.size, STAGES))
        theta = 1.0 + self.table.c * self.h / self.last_step
        k = np.arange(1, STAGES + 1)
        return np.asarray(self.polynomial @ (theta[:, None] ** k - 1.0).T)

    def _error(self, rate: Floats, Z: Floats) -> float:
        scale = np.maximum(self._scale(self.z), self._scale(self.z + Z[:, -1]))
        pull = np.asarray(self.system.mass(Z @ self.table.estimate).real) / self.h
        error = self.solvers[0]((rate + pull).astype(np.complex128)).real
        if self._norm(error, scale) > 1.0:
            # A second filtering: the first overestimates stiff components.
            again = self.system.rate(self.z + error)
            if np.all(np.isfinite(again)):
                error = self.solvers[0]((again + pull).astype(np.complex128)).real
        return self._norm(error, scale)

    def _accept(self, Z: Floats) -> None:
        self.polynomial = Z @ self.table.polynomial
        piece = np.column_stack([self.system.watch(self.z), self.system.watch(self.polynomial)])
        self.out.pieces.append(piece)
        self.z = self.z + Z[:, -1]
        self.t += self.h
        self.last_step = self.h
        self.out.ends.append(self.t)
        self.out.steps += 1
        self.out.escaped = bool(np.abs(self.z).max(initial=0.0) > self.limit)
