"""Radau IIA collocation with any odd number of stages: its coefficients, and its dense output.

With s stages the order is 2s - 1, L-stable and stiffly accurate, so the equations may be of index 1
(Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.5 and IV.8). Between the
stages the solution is a polynomial of degree s through the start and the stages.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError


@dataclass(frozen=True, slots=True, eq=False)
class Tableau:
    """One method, in the basis that decouples its stages.

    `c` (s,) are the collocation points, the last of which is 1; `shifts` ((s + 1) / 2,) the
    eigenvalues of the inverse of the method's matrix: the real one, then one of each pair. `left`
    and `right` transform: ``W = left Z``, ``Z = Re(right W)``. The product of `legendre`
    (s + 1, s + 1) with values at 0 and c gives the coefficients of the Legendre polynomials of
    ``2 theta - 1``.
    """

    c: Floats
    shifts: Complexes
    left: Complexes
    right: Complexes
    legendre: Floats


def tableau(stages: int) -> Tableau:
    """Compute the Radau IIA method with `stages` stages (odd)."""
    from numpy.polynomial.legendre import Legendre, legvander

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
    return Tableau(
        c=c,
        shifts=values[kept].astype(np.complex128),
        left=np.linalg.inv(vectors)[kept].astype(np.complex128),
        right=(vectors[:, kept] * weight).astype(np.complex128),
        legendre=np.linalg.inv(legvander(2.0 * np.append(0.0, c) - 1.0, stages)).astype(np.float64),
    )


STAGES = 9
TABLE = tableau(STAGES)
SIGMA = TABLE.left.sum(axis=1)

ESCAPED = 1e8  # of the board's largest voltage: a board above it has diverged, and the record ends
# Error over last Legendre coefficient of a mode much faster than a step: the stages are all at its
# end, so that the coefficient is half of its change; a mode that rings may be off by twice that.
LAYER = 4.0
RESOLVED = 1.0 / 16.0  # of a coefficient: that of half a step which resolves its modes is 1/256
SAME = 1e-12  # relative: two instants that only rounding tells apart


@dataclass(eq=False)
class Dense:
    """Dense output: Legendre coefficients of the watched voltages in every step."""

    ends: list[float] = field(default_factory=lambda: [0.0])  # 0 and the end of every step, s
    pieces: list[Floats] = field(default_factory=list)  # (W, s + 1): coefficients over a step
    # Binary logarithms of the lengths, in units of the base.
    levels: list[int] = field(default_factory=list)
    factorisations: int = 0  # what it cost
    escaped: bool = False  # whether it ended early because a voltage passed its limit
    # What rounding left where it was more than a small part of the tolerance, V.
    rounding: float = 0.0
    tail: float = 0.0  # the largest last Legendre coefficient of a step, V, without its rounding
    failure: str = ""  # why the integration ended without a solution, or empty

    def checked(self, board: str) -> Dense:
        """Return this output; raise EngineError, with the name of the board, without a solution."""
        if self.failure:
            raise EngineError(f"board {board!r}: {self.failure}; try --engine ngspice")
        return self

    def doubt(self, whole: Dense) -> float:
        """Return what the difference to the run `whole` with twice the steps does not show, V.

        That is rounding, and what modes do that are too fast for the steps of both runs. Half a
        step that resolves its modes has a far smaller coefficient.
        """
        unresolved = self.tail if self.tail > RESOLVED * whole.tail else 0.0
        return self.rounding + LAYER * unresolved

    def level_within(self, t: float, base: float) -> int:
        """Return the least level of the steps that half the step at `t`, s, would overlap."""
        last = self.steps - 1
        first = min(bisect_right(self.ends, t * (1.0 + SAME)) - 1, last)
        end = t + 0.5 * base * 2.0 ** self.levels[first]
        return min(self.levels[first : max(bisect_left(self.ends, end * (1.0 - SAME)), first + 1)])

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return len(self.pieces)

    @cached_property
    def _whole(self) -> tuple[Floats, Floats]:
        """The ends and the coefficients of all steps, of an integration that has ended."""
        return np.array(self.ends), np.stack(self.pieces)

    def at(self, times: Floats) -> Floats:
        """Watched voltages at `times`, shape (P, W)."""
        from numpy.polynomial.legendre import legvander

        ends, pieces = self._whole
        which = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, self.steps - 1)
        theta = (times - ends[which]) / (ends[which + 1] - ends[which])
        basis = legvander(2.0 * theta - 1.0, STAGES)
        return np.asarray((pieces[which] @ basis[:, :, None])[:, :, 0])
