"""Amplifiers of straight pieces: where a step leaves one, and the cycle in which a board may end.

In a step every such amplifier goes on along its straight piece, so that nothing in the step bends.
The step ends at the first root of (input - break) on its polynomial, and the next one begins on the
next piece. A root is found by halving: a polynomial lies within the hull of its Bernstein
coefficients, so no passage is missed, also two in one step.

The right-hand side of a board with a continuous g is Lipschitz continuous, so one solution passes
through every state: it neither slides along a break nor chatters there. Only an amplifier that
drives its own input without any delay, by a gain above 1, makes the equations ambiguous, as a
Schmitt trigger's are; `JUMPS` refuses that in words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np
from numpy.polynomial.legendre import legvander

from taction.system.array_types import EPS, Complexes, Floats
from taction.system.quantities import show
from taction.verification.engines.statespace.transients.radau import NODES, STAGES, TABLE

SLACK = 1e-3  # of the tolerance: how far behind a break an output counts as beyond it
ROUNDED = 256 * EPS  # of the largest input: the least slack
PASSED = 0.4  # of the slack: amplifiers so far behind a break pass it together
NARROW = 2.0**-48  # of a step: an interval that is not halved
MOST_SWITCHES = 2000
JUMPS = (
    "some of its amplifiers drive their own inputs without delay, by a gain above 1: the board has"
    " several voltages for one state, and jumps. Give the op-amps a bandwidth, or the signal nodes"
    " a capacitance"
)
RETURNED = 1e-5  # of the largest state: two switches at the same point of a cycle
ROOM = 1e-3  # of the largest state: the least extent of a cycle


@cache
def _bernstein() -> tuple[Floats, Floats, Floats]:
    """Return Bernstein from Legendre coefficients, and those of both halves, (s + 1, s + 1)."""
    n = STAGES
    made = np.zeros((n + 1, n + 1))
    for i in range(n + 1):
        for k in range(n + 1):
            each = range(max(0, i + k - n), min(i, k) + 1)
            terms = ((-1) ** (k + j) * comb(k, j) ** 2 * comb(n - k, i - j) for j in each)
            made[i, k] = sum(terms) / comb(n, i)
    left = np.array([[comb(i, j) / 2.0**i for j in range(n + 1)] for i in range(n + 1)])
    return made, left, left[::-1, ::-1].copy()


def hull(piece: Floats) -> Floats:
    """Return Bernstein coefficients of Legendre coefficients (..., s + 1)."""
    return np.asarray(piece @ _bernstein()[0].T)


def first_passage(excess: Floats) -> float:
    """Return where the first of polynomials on [0, 1] becomes positive, or just behind; 1 if none.

    `excess` (Q, s + 1) are their Bernstein coefficients in units of the slack.

    Examples
    --------
    >>> line = np.linspace(-1e6, 3e6, STAGES + 1)  # -1e6 + 4e6 t
    >>> round(first_passage(line[None]), 6)
    0.25
    """
    _, left, right = _bernstein()
    todo = [(0.0, 1.0, excess)]
    while todo:
        begin, width, rows = todo.pop()
        rows = rows[rows.max(axis=1) > 0.0]
        if not len(rows):
            continue
        if (rows[:, 0] > 0.0).any():
            return begin
        if width < NARROW or np.ptp(rows, axis=1).min() < 0.5:
            return begin + width
        width *= 0.5
        todo += [(begin + width, width, rows @ right.T), (begin, width, rows @ left.T)]
    return 1.0


def shortened(piece: Floats, theta: float) -> tuple[Floats, Floats, Complexes]:
    """Cut steps with Legendre coefficients (W, s + 1) at `theta`.

    Return the coefficients of what is left, the values at its end (W,), and the weights (k,) by
    which the method's systems give the change of the states up to there.
    """
    values = piece @ legvander(2.0 * theta * NODES - 1.0, STAGES).T
    basis = legvander(np.array([2.0 * theta - 1.0]), STAGES)[0] @ TABLE.legendre
    return values @ TABLE.legendre.T, values[:, -1], basis[1:] @ TABLE.right


@dataclass(frozen=True, slots=True, eq=False)
class Switch:
    """The start of a stretch on straight pieces `segments` (m,), at `time`, s, in a `state`."""

    time: float
    segments: tuple[int, ...]
    state: Complexes


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """A transient that repeats itself: from `begin`, s, with a `period`, s, of some `switches`."""

    begin: float
    period: float
    switches: int

    def __str__(self) -> str:
        begin, period = show(self.begin, "s"), show(self.period, "s")
        return f"a limit cycle from {begin} on: period {period}, {self.switches} switches a period"


def limit_cycle(switches: Sequence[Switch]) -> LimitCycle | None:
    """Return the cycle in which a transient ends, or None."""
    last = switches[-1]
    size = max(float(np.abs(switch.state).max(initial=0.0)) for switch in switches)
    for k in range(len(switches) - 2, -1, -1):
        begin = switches[k]
        away = np.abs(begin.state - last.state).max(initial=0.0)
        if begin.segments == last.segments and away <= RETURNED * size:
            inner = [np.abs(each.state - last.state).max(initial=0.0) for each in switches[k:-1]]
            if max(inner) < ROOM * size:
                return None
            return LimitCycle(begin.time, last.time - begin.time, len(inner))
    return None
