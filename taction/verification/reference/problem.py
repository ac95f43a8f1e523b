"""The problems and the solutions of the reference solver, also scaled so that |T| is near 1."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError, SolverError
from taction.system.results import Result
from taction.verification.reference.regularisers import REGULARISERS, Regulariser

RELATIVE_ERROR = 1e-6
"""A solution is trusted when its error bound is below this times its largest entry."""
ENOUGH = 1e-3 * RELATIVE_ERROR
"""Relative error bound at which refinement ends."""
SMALLEST_SCALE = 1e-11
"""Least value of that largest entry (times |eps| / |T| for the linear regulariser)."""


def _freeze(instance: object, *keys: str) -> None:
    """Replace arrays by read-only copies in double precision."""
    for key in keys:
        value = getattr(instance, key)
        own = isinstance(value, np.ndarray) and value.dtype == np.float64 and value.flags.owndata
        if own and not value.flags.writeable:  # the T that many strains share
            continue
        copy = np.array(value, dtype=np.float64)
        copy.setflags(write=False)
        object.__setattr__(instance, key, copy)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Minimise ``|T u - eps|^2 + lam * Omega(u)`` over u; dimensionless.

    InputError: every wrong value at once.
    """

    T: Floats  # (M, N): finite
    eps: Floats  # (M,): finite
    lam: float  # positive; 0 only for the linear regulariser
    # A key of `REGULARISERS`: ``linear`` is ``sum u^2``; every other is
    # ``sum of the integral of g^-1`` (eq 17).
    regulariser: str = "linear"
    # Whether the bias current adds ``sum u`` to Omega; with ``exponential`` this turns
    # ``sum (u log u - u)`` into the entropy ``sum u log u``.
    bias: bool = False
    # Share of the ridge term ``sum u^2 / 2`` that stays in Omega, 0 to 1; below 1 only for a
    # regulariser of straight pieces.
    ridge_share: float = 1.0

    def __post_init__(self) -> None:
        _freeze(self, "T", "eps")
        object.__setattr__(self, "lam", float(self.lam))
        T, lam, share, linear = self.T, self.lam, self.ridge_share, self.regulariser == "linear"
        known, matrix = self.regulariser in REGULARISERS, T.ndim == 2 and 0 not in T.shape
        pieces = known and REGULARISERS[self.regulariser].pieces
        shared = share == 1.0 or (pieces and 0.0 <= share <= 1.0)
        positive = lam > 0.0 or (lam == 0.0 and linear)
        rows, finite = f"one entry per row of T: {T.shape[:1]}", "every entry must be finite"
        shares = "0 to 1 for a regulariser of straight pieces, else 1"
        allowed = f"must be finite and {'at least 0' if linear else 'positive'}"
        unbiased = "the linear regulariser has no bias current"
        tests = (
            (matrix, "T", f"shape {T.shape}", "an M x N matrix is needed"),
            (not matrix or self.eps.shape == T.shape[:1], "eps", f"shape {self.eps.shape}", rows),
            (shared, "ridge_share", repr(share), shares),
            (np.isfinite(T).all(), "T", "", finite),
            (np.isfinite(self.eps).all(), "eps", "", finite),
            (known, "regulariser", self.regulariser, f"one of {', '.join(REGULARISERS)}"),
            (positive and lam < math.inf, "lam", repr(lam), allowed),
            (not (self.bias and linear), "bias", "True", unbiased),
        )
        if wrong := [Complaint(*words) for true, *words in tests if not true]:
            raise InputError("reference problem", *wrong)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Solution(Result):
    """A solution with its certificate.

    Attributes
    ----------
    problem : Problem
        The problem, so that every figure below can be computed again.
    u : ndarray (N,)
        The minimiser.
    v : ndarray (N,) or None
        ``g^-1(u)``, which stays finite where u underflows. None for the linear regulariser.
    objective : float
        ``|T u - eps|^2 + lam * Omega(u)``.
    certificate_kind : str
        ``duality gap`` (an upper bound on the objective above its minimum) or ``relative
        residual`` (of the normal equations, over ``|T|^2 |u| + |T| |eps|``).
    certificate : float
        Value of the certificate; not a number if the solver could not evaluate it.
    bound : float
        Largest certificate of a trusted solution.
    error_bound : float
        Upper bound on ``max |u - u*|``; infinite if no bound is known.
    trusted : bool
        The certificate is below its bound, so the error is below ``1e-6 max |u|``.
    condition : float
        Condition number of the equations that were solved last.
    iterations : int
        Newton steps and refinement steps.
    seconds : float
        Wall time.
    reason : str
        Why the solution is not trusted and what to do; empty for a trusted solution.
    """

    VIEW = "taction.verification.report.views.verdict_view:solution_view"
    DOCUMENT = (
        *("outcome", "u [V]", "v [V]", "lambda = lam", "objective"),
        *("certificate.kind = certificate_kind", "certificate.value = certificate"),
        *("certificate.bound = bound", "error_bound", "condition", "iterations", "trusted"),
        *("reason", "seconds [s]"),
    )

    problem: Problem
    u: Floats
    v: Floats | None
    objective: float
    certificate_kind: str
    certificate: float
    bound: float
    error_bound: float
    trusted: bool
    condition: float
    iterations: int
    seconds: float
    reason: str = ""

    @property
    def outcome(self) -> str:
        """``pass`` if it is trusted, else ``inconclusive``."""
        return "pass" if self.trusted else "inconclusive"

    def __repr__(self) -> str:
        trust = "trusted" if self.trusted else f"not trusted: {self.reason}"
        return (
            f"Solution({len(self.u)} channels, lambda = {self.lam:.4g},"
            f" error in u at most {self.error_bound:.2g}, {trust})"
        )

    def __post_init__(self) -> None:
        _freeze(self, *(["u"] if self.v is None else ["u", "v"]))

    @property
    def lam(self) -> float:
        """Regularisation of the problem."""
        return self.problem.lam


def solution_difference(one: Solution, other: Solution) -> tuple[float, float]:
    """Return the largest difference of two solutions, and the same with the errors of both.

    The second is infinite if one of them is not trusted; u has no unit.
    """
    change = float(np.max(np.abs(other.u - one.u)))
    known = one.trusted and other.trusted
    return change, change + one.error_bound + other.error_bound if known else math.inf


LARGEST = 1e150
"""Numbers above this are refused: their products overflow."""
Extended = Any
"""An array of longdouble: 64 bits, or 53 where the processor has no more. Bounds follow."""


def norm(x: Extended) -> float:
    """Return the 2-norm of a vector."""
    return math.hypot(*x.tolist())


@dataclass(frozen=True, slots=True, eq=False)
class ScaledProblem:
    """Minimise ``1/2 |T u - eps|^2 + mu sum(phi(u) + beta u)``, with |T| near 1.

    The division by a power of two is exact, so this is the same problem; general solvers given
    T at 1e-12 report success with half of u wrong.
    """

    T: Floats  # (M, N), Frobenius norm between 0.7 and 1.5, or 0
    eps: Floats  # strain over `scale` (M,)
    mu: float  # `lam` times the regulariser's weight, over the square of `scale`
    beta: float  # 1 with bias, else 0
    scale: float  # the power of two
    norm: float  # Frobenius norm of T
    h: Floats  # diagonal of ``T^T T`` (N,), positive
    regulariser: Regulariser

    @classmethod
    def of(cls, problem: Problem) -> ScaledProblem:
        """Scale a problem; SolverError if lam or eps then overflows."""
        peak = float(np.max(np.abs(problem.T)))
        length = np.sqrt(np.sum((problem.T / peak) ** 2)) if peak > 0.0 else 0.0
        scale = float(2.0 ** np.rint(np.log2(peak * length))) if peak > 0.0 else 1.0
        T = problem.T / scale
        regulariser = REGULARISERS[problem.regulariser]
        mu = regulariser.weight * problem.lam / scale / scale
        h = np.sum(T * T, axis=0)
        if not np.isfinite(mu):
            raise SolverError(f"T of norm {peak * length!r} is too small for lambda")
        square = float(h.sum())
        h = np.maximum(h, max(1e-30 * square, float(np.finfo(float).tiny)))
        beta, norm = float(problem.bias), float(np.sqrt(square))
        scaled = cls(T, problem.eps, mu, beta, scale, norm, h, regulariser)
        return scaled.with_strain(problem.eps)

    def residuals(
        self, u: Extended, r: Extended, *loads: Extended
    ) -> tuple[Floats, Floats, float, Floats]:
        """Return ``eps - T u - r`` and ``T^T r - sum of loads``, and bounds on their rounding.

        The bound of the first is one of its norm, that of the second one of each element: that of
        sums of n products in the precision of u and r.
        """
        T = self.T.astype(np.longdouble)
        f1 = np.asarray(self.eps - T @ u - r, dtype=np.float64)
        f2 = np.asarray(T.T @ r - sum(loads), dtype=np.float64)
        unit = (max(T.shape) + 4) * float(np.finfo(T.dtype).eps) / 2.0
        off1 = unit * (self.norm * norm(u) + norm(r) + norm(self.eps))
        off2 = unit * (np.sqrt(self.h) * norm(r) + sum(map(np.abs, loads)))
        return f1, f2, off1, np.asarray(off2, dtype=np.float64)

    def with_strain(self, eps: Floats) -> ScaledProblem:
        """Return the problem with the unscaled strain `eps`; SolverError if it overflows."""
        divided = eps / self.scale
        if not np.all(np.abs(divided) < LARGEST):
            raise SolverError(f"T of norm {self.norm * self.scale!r} is too small for eps")
        return replace(self, eps=divided)
