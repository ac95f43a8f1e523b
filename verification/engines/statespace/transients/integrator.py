"""The integrator of everything that has no exact solution: Radau IIA steps, dense output, events.

The remainders of the amplifiers (see `steps`) are found by iterating on the inputs of all stages;
each iteration is a simplified Newton step, whose Jacobian is that of the amplifiers' slopes, kept
over steps until convergence is slow. The lengths of steps are powers of two, so that each is
prepared once. The length follows from the last Legendre coefficients of the solution in a step,
which decrease like its error: they bound the error of the polynomial between the stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.transients.steps import (
    STAGES,
    TABLE,
    Amplifiers,
    Board,
    Step,
)

ITERATIONS = 12  # of the inputs in a step
SHARE = 0.002  # of the tolerance: what the iterations leave
SLOW = 0.2  # contraction above which the next step is linearised anew
LONGEST_JUMP = 3  # levels
SMALLEST = -60  # level
LAST_BUT_ONE = 0.2  # weight of the last but one Legendre coefficient in the error
SPREAD = 3.0  # times what rounding made of one draw: what it may make of another one
# Of a change: rounding of the stages' sums over the systems of the method, as random errors add.
SCATTER = EPS / SPREAD * float(np.sqrt(np.abs(TABLE.right) ** 2 @ np.abs(TABLE.left) ** 2).max())
COUNTED = 0.01  # of the tolerance: rounding above it is added up
# Error over last Legendre coefficient of a mode much faster than a step: the stages are all at its
# end, so that the coefficient is half of its change; a mode that rings may be off by twice that.
LAYER = 4.0
RESOLVED = 1.0 / 16.0  # of a coefficient: that of half a step which resolves its modes is 1/256
KEPT = 12  # levels beside the present one whose steps stay prepared


@dataclass(slots=True, eq=False)
class Dense:
    """Dense output: Legendre coefficients of the watched voltages in every step.

    Attributes
    ----------
    ends : list of float
        0 and the end of every step, s.
    pieces : list of ndarray (W, s + 1)
        Coefficients over a step.
    levels : list of int
        Binary logarithms of the lengths, in units of the base.
    rejected, factorisations : int
        What it cost.
    escaped : bool
        Whether it ended early because a voltage passed its limit.
    rounding : float
        What rounding left where it was more than the tolerance, V.
    coarse : bool
        Whether it was in a step.
    tails : list of float
        The largest last Legendre coefficient of each accepted step, V, without its rounding.
    """

    ends: list[float] = field(default_factory=lambda: [0.0])
    pieces: list[Floats] = field(default_factory=list)
    levels: list[int] = field(default_factory=list)
    rejected: int = 0
    factorisations: int = 0
    escaped: bool = False
    rounding: float = 0.0
    coarse: bool = False
    tails: list[float] = field(default_factory=list)

    def unresolved(self, whole: Dense) -> float:
        """Return what fast modes can do within steps that are too long for them, V.

        Half the steps of the run `whole` are too long, too, so the difference of the two runs does
        not show it. In a step that resolves its modes half of it has a far smaller coefficient.
        """
        pairs = zip(whole.tails, self.tails[::2], self.tails[1::2], strict=False)
        halves = ((one, max(first, second)) for one, first, second in pairs)
        return LAYER * max((half for one, half in halves if half > RESOLVED * one), default=0.0)

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return len(self.pieces)

    def at(self, times: Floats) -> Floats:
        """Watched voltages at `times`, shape (P, W)."""
        from numpy.polynomial.legendre import legvander

        ends = np.array(self.ends)
        which = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, self.steps - 1)
        theta = (times - ends[which]) / (ends[which + 1] - ends[which])
        basis = legvander(2.0 * theta - 1.0, STAGES)
        steps, place = np.unique(which, return_inverse=True)
        pieces = np.stack([self.pieces[k] for k in steps.tolist()])
        return np.asarray((pieces[place] @ basis[:, :, None])[:, :, 0])


class Reported(Protocol):
    """The amplifiers of a board, and what is reported of its watched voltages."""

    amplifiers: Amplifiers

    def volts(self, inputs: Floats) -> Floats:
        """Return reported volts for a volt of each watched voltage, at inputs (m, s); (W,)."""
        ...

    def distance(self, watched: Floats) -> float:
        """Return the largest distance of a reported voltage from rest, V, for watched (W,)."""
        ...


class Integrator:
    """One integration from t = 0.

    Parameters
    ----------
    board : Board
        The linear part.
    reported : Reported
        The amplifiers, and what is reported.
    state : ndarray
        Of the board at the start.
    start : ndarray (W,)
        Watched voltages at the start, inputs first, V.
    slopes : ndarray (m,)
        At which the first steps are linearised, V/V.
    tolerance, unit : float
        Of one step, and the voltage to which it is relative, V.
    base : float
        Length of a step of level 0, s.
    limit : float
        Watched voltage at which the integration ends early (`Dense.escaped`), V.
    """

    def __init__(
        self,
        board: Board,
        reported: Reported,
        state: Floats,
        start: Floats,
        slopes: Floats,
        tolerance: float,
        unit: float,
        base: float,
        limit: float = math.inf,
    ) -> None:
        self.board, self.reported, self.state, self.now = board, reported, state, start
        self.amplifiers = reported.amplifiers
        self.tolerance, self.base, self.limit = tolerance, base, limit
        self.level, self.t, self.out = 0, 0.0, Dense()
        self.slopes = slopes
        self.prepared: dict[int, Step] = {}
        self.noise: dict[int, Floats] = {}
        self.relative = tolerance / unit
        self.draw = np.random.default_rng(1992)

    def run(self, stop: float, max_steps: int = 1_000_000) -> Dense:
        """Integrate to `stop`, s, or beyond it, or until a voltage passes the limit.

        Raises
        ------
        EngineError
            The solution leaves the range of floats, or the step underflows.
        """
        while self.t < stop * (1.0 - 1e-12) and not self.out.escaped:
            self.level = min(self.level, math.ceil(math.log2((stop - self.t) / self.base)))
            self._advance()
            if self.out.steps > max_steps:
                raise EngineError(f"{max_steps} steps did not reach {stop!r} s (now {self.t!r} s)")
        return self.out

    def repeat(self, levels: list[int]) -> Dense:
        """Take steps of given levels."""
        for level in levels:
            self.level = level
            self._advance(fixed=True)
        return self.out

    def _step(self, level: int) -> Step:
        if level not in self.prepared:
            length = self.base * 2.0**level
            self.prepared = {k: v for k, v in self.prepared.items() if abs(k - level) <= KEPT}
            self.prepared[level] = self.board.step(length, self.slopes)
            self.out.factorisations += len(TABLE.shifts)
        return self.prepared[level]

    def _advance(self, *, fixed: bool = False) -> None:
        """Take one accepted step."""
        fresh = False  # whether the step is linearised at its own start
        while True:
            if self.base * 2.0**self.level <= EPS * self.t or self.level < SMALLEST:
                raise EngineError(f"the time step fell below the rounding of {self.t!r} s")
            step = self._step(self.level)
            found = self._iterate(step)
            if found is None:
                if fixed and fresh:
                    raise EngineError(f"the iterations do not converge at {self.t!r} s")
                self.level -= fresh
                if not fresh:
                    self._linearise(self.now[: self.amplifiers.count, None])
                fresh = not fresh
                self.out.rejected += 1
                continue
            inputs, remainder, parts, contraction = found
            change, watched = step.end(remainder, inputs, parts)
            watched = self.now[:, None] + watched
            piece = np.column_stack([self.now, watched]) @ TABLE.legendre.T
            gain, left, tail = self._judge(step, piece, watched)
            if gain >= 0 or fixed:
                break
            self.level += max(gain, -LONGEST_JUMP)
            self.out.rejected += 1
        self.out.tails.append(tail)
        self._accept(self.state + change, watched, piece, left)
        if contraction > SLOW and not fresh:
            self._linearise(watched[: self.amplifiers.count, -1:])
        if not fixed:
            self.level += min(gain, LONGEST_JUMP)

    def _judge(self, step: Step, piece: Floats, watched: Floats) -> tuple[int, float, float]:
        """Return by how many levels the step could be longer, what rounding leaves, and the tail.

        Both are in V; the tail is the size of the last Legendre coefficients above rounding.
        """
        last = np.maximum(np.abs(piece[:, -1]), LAST_BUT_ONE * np.abs(piece[:, -2]))
        volts = self.reported.volts(watched[: self.amplifiers.count])
        # Growing voltages count by their size.
        tolerance = max(self.tolerance, self.relative * self.reported.distance(self.now))
        noise = self._rounding(step, volts)
        size = float((last * volts).max(initial=0.0))
        if not math.isfinite(size):
            return -1, 0.0, 0.0
        tail = max(size - noise, 0.0)
        error = tail / max(tolerance, noise)
        self.out.coarse |= noise > tolerance
        gain = math.floor(-math.log2(max(error, 1e-300)) / STAGES)
        return gain, noise if noise > COUNTED * tolerance else 0.0, tail

    def _rounding(self, step: Step, volts: Floats) -> float:
        """Return what rounding of the state and of the amplifiers makes of the inputs, V.

        It is measured once for each prepared step.
        """
        if self.level not in self.noise:
            m, rates = self.amplifiers.count, []
            outputs = self.amplifiers.outputs(self.now[:m, None])[:, 0]
            for scale in (0.0, EPS):
                state, out = (
                    x * (1.0 + scale * self.draw.standard_normal(x.shape))
                    for x in (self.state, outputs)
                )
                rates.append(self.board.rate(state, out))
            zero, noise = np.zeros((m, STAGES)), EPS * np.abs(self.now)
            for rate, share in ((rates[1] - rates[0], 1.0), (rates[0], SCATTER)):
                free, parts = step.free(rate)
                noise += share * np.abs(step.end(zero, free, parts)[1]).max(axis=1)
            self.noise[self.level] = noise
        return SPREAD * float((volts * self.noise[self.level]).max(initial=0.0))

    def _accept(self, state: Floats, watched: Floats, piece: Floats, left: float) -> None:
        self.out.pieces.append(piece)
        self.out.levels.append(self.level)
        self.out.rounding += left
        self.state, self.now = state, watched[:, -1]
        self.t += self.base * 2.0**self.level
        self.out.ends.append(self.t)
        largest = max(np.abs(self.now).max(initial=0.0), np.abs(self.state).max(initial=0.0))
        self.out.escaped = bool(max(largest, self.reported.distance(self.now)) > self.limit)

    def _linearise(self, inputs: Floats) -> None:
        """Linearise the next steps at inputs (m, s), by the mean slopes."""
        slopes = self.amplifiers.slopes(inputs).mean(axis=1)
        if np.all(np.isfinite(slopes)):
            self.slopes = slopes
            self.prepared, self.noise = {}, {}

    def _iterate(self, step: Step) -> Any:
        """Find the inputs of all stages; None if the iterations do not converge.

        Return the inputs and the remainders that they belong to, what `step.end` needs, and the
        contraction.
        """
        m = self.amplifiers.count
        now = self.now[:m, None]
        outputs = self.amplifiers.outputs(now)
        rate = self.board.rate(self.state, outputs[:, 0])
        free, parts = step.free(rate)
        if not m:
            return free, free, parts, 0.0
        volts, slopes = self.reported.volts(now)[:m, None], step.slopes[:, None]

        def size_of(change: Floats) -> float:
            return float((np.abs(change) * volts).max()) / self.tolerance

        # At the start of the step there are no remainders: the first iteration gives `free`.
        inputs, remainder, before = free, np.zeros((m, STAGES)), size_of(free)
        if before < 1e-3 * SHARE:
            return inputs, remainder, parts, 0.0
        for k in range(1, ITERATIONS):
            remainder = self.amplifiers.outputs(now + inputs) - outputs - slopes * inputs
            if not np.all(np.isfinite(remainder)):
                return None
            following = free + step.response(remainder, parts)
            size = size_of(following - inputs)
            if not math.isfinite(size):
                return None
            inputs, contraction = following, size / before
            if contraction < 1.0 and contraction / (1.0 - contraction) * size < SHARE:
                return inputs, remainder, parts, contraction
            if contraction >= 1.0 or k == ITERATIONS - 1:
                settled = size * self.tolerance <= self._rounding(step, self.reported.volts(now))
                return (inputs, remainder, parts, 0.0) if settled else None
            before = size
        return None
