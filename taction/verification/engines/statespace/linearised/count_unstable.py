"""Count the poles right of a vertical line by the winding of the determinant.

``det(s M - K)`` is a polynomial of degree n whose roots are the poles. Along a vertical line from
the real axis upwards its argument turns by ``pi/2 (left - right)``. The determinant is the product
of two: that of the cells, whose poles are known one by one, and that of the Schur complement S on
the summing nodes (see `structured_solve`), which is followed from point to point. There the change
of the argument is the sum over the eigenvalues of ``S(s1)^-1 S(s2)``. Each of these starts at 1 and
moves little in a short step, so none is lost, even if many modes have one frequency. The count is
independent of any search for poles.
"""

from __future__ import annotations

import math

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.structured_solve import Structure

TOP = 1e5  # of the line, in units of the board's fastest rate
FREQUENCY_RATIO = 4.0  # largest ratio of neighbouring frequencies
INFINITE = 1e-13  # fastest rate over a pole: a smaller ratio is a pole at infinity
LARGEST_TURN = 1.0  # of one eigenvalue in a step, rad
ROUNDING = 16.0 * EPS
"""Distance of a pole from the line, in units of the fastest rate, at which rounding may decide its
side. The steps beside a pole are about as long as its distance. Measured on boards of 7 to 20
channels: with lines up to a quarter of this distance from a pole, some counts are wrong."""


def count_right(structure: Structure, abscissa: float = 0.0) -> int:
    """Count the poles with a real part above `abscissa`, 1/s.

    The vertical line must not pass through a pole.

    Raises
    ------
    EngineError
        A pole lies on the line to within rounding, or the count is not a whole number.

    Notes
    -----
    Costs some 50 to 100 structured factorisations and dense eigenproblems of half the size of the
    Schur complement each (N = 7: 0.1 s; N = 128: seconds).
    """
    rates, cells = cell_poles(structure)
    fastest = float(rates.max(initial=1.0))
    top = TOP * fastest
    low, high = _Point(structure, abscissa + 1j * top), _Point(structure, abscissa + 2j * top)
    degree = (high.log_size - low.log_size) / math.log(2.0)
    turn = _schur_turn(structure, abscissa, fastest, top)
    offset = abscissa - cells.real
    if np.any(np.abs(offset) <= ROUNDING * fastest):
        raise EngineError(f"a pole of a single cell lies on the line at {abscissa!r} /s")
    upper, lower = (np.arctan((omega - cells.imag) / np.abs(offset)) for omega in (top, 0.0))
    turn += float(np.sum(np.sign(offset) * (upper - lower)))
    right = float(0.5 * (len(cells) + degree - turn / (0.5 * math.pi)))
    if abs(right - round(right)) > 0.05:
        raise EngineError(f"the winding number gives {right!r} poles, which is not a whole number")
    return round(right)


class _Point:
    """The Schur complement at one s, and the logarithm of its determinant's size."""

    def __init__(self, structure: Structure, s: complex) -> None:
        self.s = s
        self.schur = structure.factor(s, solver=False).schur
        sign, self.log_size = np.linalg.slogdet(self.schur)
        if sign == 0.0:
            raise EngineError(f"a pole lies at {s!r} /s")


def _schur_turn(structure: Structure, abscissa: float, fastest: float, top: float) -> float:
    """Return the total turn of the Schur complement's determinant along the line, rad."""
    start = 1e-6 * fastest
    count = max(math.ceil(math.log(top / start) / math.log(FREQUENCY_RATIO)), 1)
    total, point = 0.0, _Point(structure, complex(abscissa))
    for omega in np.geomspace(start, top, count + 1).tolist():
        ahead = [_Point(structure, abscissa + 1j * omega)]
        while ahead:
            ratio = np.linalg.solve(point.schur, ahead[-1].schur)
            turns = np.angle(np.linalg.eigvals(ratio))
            if np.abs(turns).max(initial=0.0) <= LARGEST_TURN:
                total += float(turns.sum())
                point = ahead.pop()
                continue
            if abs(ahead[-1].s - point.s) <= ROUNDING * fastest:
                raise EngineError(f"a pole lies on the line near {point.s!r} /s")
            ahead.append(_Point(structure, 0.5 * (point.s + ahead[-1].s)))
    return total


def cell_poles(structure: Structure) -> tuple[Floats, Complexes]:
    """Return the board's rates (1/s), and the poles of each separate cell."""
    poles, rates = [], []
    for group in structure.groups:
        M, K = group.mass, group.stiffness
        weight = np.abs(M).max(axis=2)
        rate = np.abs(K).max(axis=2)[weight > 0.0] / weight[weight > 0.0]
        if not len(rate):
            continue
        rates.append(rate)
        poles += [_finite_poles(*cell, float(rate.max())) for cell in zip(M, K, strict=True)]
    if len(structure.outer):
        M, K = (abs(part).max(axis=1).toarray().ravel() for part in structure.parts["oo"])
        rates.append(K[M > 0.0] / M[M > 0.0])
    all_poles = np.concatenate([*poles, np.zeros(0)]).astype(np.complex128)
    return np.concatenate([*rates, np.zeros(0)]), all_poles


def _finite_poles(M: Floats, K: Floats, fastest: float) -> Complexes:
    """Return the finite s with ``det(s M - K) = 0``, 1/s, slow ones as accurately as fast ones.

    The QZ method needs no inverse; a shift to the fastest rate would round the slow poles to
    ``eps fastest``, and even their sign where a cell is nearly defective.
    """
    from scipy.linalg import eig

    rows = np.abs(K).max(axis=1, keepdims=True)
    alpha, beta = eig(K / rows, fastest * M / rows, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > INFINITE * np.abs(alpha)
    return np.asarray(fastest * alpha[finite] / beta[finite], dtype=np.complex128)
