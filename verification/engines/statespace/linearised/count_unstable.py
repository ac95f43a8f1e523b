"""Counting the poles right of a line by the winding of the loop's determinant.

``det(s M - K)`` is a polynomial of degree n with the poles for roots. Along a vertical line from
the real axis upwards its argument turns by ``pi/2 (left - right)``. The determinant is that of the
cells, whose own poles are known one by one, times that of the Schur complement on the summing
nodes (see `structure`), which is followed from point to point. There the argument is the sum of
those of the eigenvalues of ``S(s1)^-1 S(s2)``: each starts at 1 and moves little in a short step,
so none can be lost, however many modes ring at one frequency. The count is independent of any
search for poles.
"""

from __future__ import annotations

import math

import numpy as np

from spice_models.array_types import Complexes, Floats
from spice_models.errors import EngineError
from verification.engines.statespace.equations.structured_solve import Structure

BEYOND = 1e5  # top of the line, over the fastest rate of the board
OCTAVE = 4.0  # largest ratio of neighbouring frequencies
CALM = 1.0  # largest turn of one eigenvalue in a step, rad
DEEPEST = 60  # halvings of a step before the line counts as touching a pole


def count_right(structure: Structure, abscissa: float = 0.0) -> int:
    """Count the poles with a real part above `abscissa`, 1/s.

    Parameters
    ----------
    structure : Structure
        The board.
    abscissa : float
        Of the vertical line; not on a pole.

    Raises
    ------
    EngineError
        A pole lies on the line to working precision, or the count is not a whole number.

    Notes
    -----
    Costs some 50 to 100 structured factorisations and dense eigenproblems of half the size of the
    Schur complement each (N = 7: 0.1 s; N = 128: seconds).
    """
    rates, cells = cell_poles(structure)
    fastest = float(rates.max(initial=1.0))
    top = BEYOND * fastest
    low, high = _Point(structure, abscissa + 1j * top), _Point(structure, abscissa + 2j * top)
    degree = (high.size - low.size) / math.log(2.0)
    turned = _follow(structure, abscissa, fastest, top)
    offset = abscissa - cells.real
    if np.any(offset == 0.0):
        raise EngineError(f"a pole of a single cell lies on the line at {abscissa!r} /s")
    ends = (np.arctan((omega - cells.imag) / np.abs(offset)) for omega in (top, 0.0))
    upper, lower = ends
    turned += float(np.sum(np.sign(offset) * (upper - lower)))
    right = float(0.5 * (len(cells) + degree - turned / (0.5 * math.pi)))
    if abs(right - round(right)) > 0.05:
        raise EngineError(f"the winding number came out as {right!r}: no whole number of poles")
    return round(right)


class _Point:
    """The Schur complement at one s, its rows scaled."""

    def __init__(self, structure: Structure, s: complex) -> None:
        self.s = s
        self.schur = structure.factor(s, solver=False).schur
        sign, self.size = np.linalg.slogdet(self.schur)
        if sign == 0.0:
            raise EngineError(f"a pole lies at {s!r} /s")


def _follow(structure: Structure, abscissa: float, fastest: float, top: float) -> float:
    """Total turn of the Schur complement's determinant along the line, rad."""
    start = 1e-6 * fastest
    count = max(math.ceil(math.log(top / start) / math.log(OCTAVE)), 1)
    grid = [0.0, *np.geomspace(start, top, count + 1).tolist()]
    total, here = 0.0, _Point(structure, complex(abscissa))
    for omega in grid[1:]:
        waiting = [_Point(structure, abscissa + 1j * omega)]
        depth = 0
        while waiting:
            there = waiting[-1]
            turns = np.angle(_ratio(here, there))
            if np.abs(turns).max(initial=0.0) <= CALM:
                total += float(turns.sum())
                here = waiting.pop()
                continue
            depth += 1
            if depth > DEEPEST:
                raise EngineError(f"a pole lies on the line near {here.s!r} /s")
            waiting.append(_Point(structure, 0.5 * (here.s + there.s)))
    return total


def _ratio(here: _Point, there: _Point) -> Complexes:
    return np.asarray(np.linalg.eigvals(np.linalg.solve(here.schur, there.schur)))


def cell_poles(structure: Structure) -> tuple[Floats, Complexes]:
    """Return the board's rates (1/s) and the poles of all its cells, each by itself."""
    found, rates = [], []
    for group in structure.groups:
        M, K = group.mass, group.stiffness
        weight = np.abs(M).max(axis=2)
        rate = np.abs(K).max(axis=2)[weight > 0.0] / weight[weight > 0.0]
        if not len(rate):
            continue
        rates.append(rate)
        shift = 1.1 * float(rate.max())
        theta = np.linalg.eigvals(np.linalg.solve(shift * M - K, M))
        theta = theta[np.abs(theta) > 1e-13 * np.abs(theta).max()]
        found.append(shift - 1.0 / theta)
    if len(structure.outer):
        M = abs(structure.parts["oo"][0]).max(axis=1).toarray().ravel()
        K = abs(structure.parts["oo"][1]).max(axis=1).toarray().ravel()
        rates.append(K[M > 0.0] / M[M > 0.0])
    poles = np.concatenate([*found, np.zeros(0)]).astype(np.complex128)
    return np.concatenate([*rates, np.zeros(0)]), poles
