"""What the reference solver is asked and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError
from verification.reference.regularisers import REGULARISERS

RELATIVE_ERROR = 1e-12
"""A solution is trusted when its error bound is below this times its largest entry."""
SMALLEST_SCALE = 1e-12
"""That entry counts as at least this (times |eps| / |T| for the linear regulariser)."""


def _frozen(value: Floats) -> Floats:
    own = isinstance(value, np.ndarray) and value.dtype == np.float64 and value.flags.owndata
    if own and not value.flags.writeable:  # the T that many strains share
        return value
    copy = np.array(value, dtype=np.float64)
    copy.setflags(write=False)
    return copy


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Minimise ``|T u - eps|^2 + lam * Omega(u)`` over u; dimensionless.

    Attributes
    ----------
    T : ndarray (M, N)
        Finite.
    eps : ndarray (M,)
        Finite.
    lam : float
        Positive; 0 only for the linear regulariser.
    regulariser : str
        A key of `REGULARISERS`: ``linear`` is ``sum u^2``; every other is
        ``sum of the integral of g^-1`` (eq 17).
    bias : bool
        Whether the bias current adds ``sum u`` to Omega; with ``exponential`` this turns
        ``sum (u log u - u)`` into the entropy ``sum u log u``.

    Raises
    ------
    InputError
        Every wrong value at once.
    """

    T: Floats
    eps: Floats
    lam: float
    regulariser: str = "linear"
    bias: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "T", _frozen(self.T))
        object.__setattr__(self, "eps", _frozen(self.eps))
        object.__setattr__(self, "lam", float(self.lam))
        complaints = tuple(self._complaints())
        if complaints:
            raise InputError("reference problem", *complaints)

    def _complaints(self) -> list[Complaint]:
        found = []
        if self.T.ndim != 2 or 0 in self.T.shape:
            found.append(Complaint("T", f"shape {self.T.shape}", "an M x N matrix is needed"))
        elif self.eps.shape != (self.T.shape[0],):
            shape = f"shape {self.eps.shape}"
            found.append(Complaint("eps", shape, f"one entry a row of T: ({self.T.shape[0]},)"))
        found += _not_finite(T=self.T, eps=self.eps)
        return found + _unusable(self.lam, self.regulariser, self.bias)


@dataclass(frozen=True, slots=True, eq=False)
class ToeplitzProblem:
    """The same with a square Toeplitz matrix that is never formed; dimensionless.

    Attributes
    ----------
    column, row : ndarray (N,)
        First column and first row of T; their first entries agree.
    eps : ndarray (N,)
        Finite.
    lam, regulariser, bias
        As in `Problem`; lam must be positive.

    Raises
    ------
    InputError
        Every wrong value at once.
    """

    column: Floats
    row: Floats
    eps: Floats
    lam: float
    regulariser: str = "linear"
    bias: bool = False

    def __post_init__(self) -> None:
        for key in ("column", "row", "eps"):
            object.__setattr__(self, key, _frozen(getattr(self, key)))
        object.__setattr__(self, "lam", float(self.lam))
        complaints = tuple(self._complaints())
        if complaints:
            raise InputError("reference problem", *complaints)

    def _complaints(self) -> list[Complaint]:
        found = []
        shapes = (self.column.shape, self.row.shape, self.eps.shape)
        if self.column.ndim != 1 or len(set(shapes)) > 1 or 0 in self.column.shape:
            found.append(Complaint("column, row, eps", str(shapes), "all of one shape (N,)"))
        elif self.column[0] != self.row[0]:
            value = f"{float(self.row[0])!r}"
            found.append(Complaint("row[0]", value, f"column[0] = {float(self.column[0])!r}"))
        found += _not_finite(column=self.column, row=self.row, eps=self.eps)
        if self.lam == 0.0:
            found.append(Complaint("lam", "0.0", "must be positive"))
        return found + _unusable(self.lam, self.regulariser, self.bias)


def _not_finite(**arrays: Floats) -> list[Complaint]:
    return [
        Complaint(key, "", "every entry must be finite")
        for key, array in arrays.items()
        if not np.all(np.isfinite(array))
    ]


def _unusable(lam: float, regulariser: str, bias: bool) -> list[Complaint]:
    found = []
    if regulariser not in REGULARISERS:
        known = ", ".join(REGULARISERS)
        found.append(Complaint("regulariser", regulariser, f"one of {known}"))
    linear = regulariser == "linear"
    if not math.isfinite(lam) or lam < 0.0 or (lam == 0.0 and not linear):
        accepted = "at least 0" if linear else "positive"
        found.append(Complaint("lam", repr(lam), f"must be finite and {accepted}"))
    if bias and linear:
        found.append(Complaint("bias", "True", "the linear regulariser has no bias current"))
    return found


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Solution:
    """An answer with the evidence for it.

    Attributes
    ----------
    problem : Problem or ToeplitzProblem
        What was asked, so that every figure below can be computed again.
    u : ndarray (N,)
        The minimiser.
    v : ndarray (N,) or None
        ``g^-1(u)``; it is finite where u underflows. None for the linear regulariser.
    objective : float
        ``|T u - eps|^2 + lam * Omega(u)``.
    certificate_kind : str
        ``duality gap`` (of the objective, so an upper bound on how far it is above its minimum)
        or ``relative residual`` (of the normal equations, over ``|T|^2 |u| + |T| |eps|``).
    certificate : float
        Its value; not a number if the solver had nothing to evaluate.
    bound : float
        What the certificate must stay below to be trusted.
    error_bound : float
        Upper bound on ``max |u - u*|``; infinite where none can be given.
    trusted : bool
        The certificate is below its bound, so the error is below ``1e-12 max |u|``, or below the
        tolerance asked for a Toeplitz problem.
    condition : float
        Condition number of the equations that were solved last.
    iterations : int
        Newton steps and refinement steps.
    seconds : float
        Wall time.
    reason : str
        Why it is not trusted and what to do; empty if it is.
    """

    problem: Problem | ToeplitzProblem
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

    def __repr__(self) -> str:
        trust = "trusted" if self.trusted else f"not trusted: {self.reason}"
        return (
            f"Solution({len(self.u)} channels, lambda = {self.lam:.4g},"
            f" error in u at most {self.error_bound:.2g}, {trust})"
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "u", _frozen(self.u))
        if self.v is not None:
            object.__setattr__(self, "v", _frozen(self.v))

    @property
    def lam(self) -> float:
        """The regularisation that was used."""
        return self.problem.lam
