"""The integrator of everything that has no exact solution: Radau IIA steps, dense output, events.

It takes several boards at a time, each with steps of its own: what a board gets does not depend on
the others, they only share the array operations. The remainders of the amplifiers (see `steps`) are
found by iterating on the inputs of all stages; each iteration is a simplified Newton step, whose
Jacobian is that of the amplifiers' slopes, kept over steps until convergence is slow. The lengths
of steps are powers of two, so that each is prepared once. The length follows from the last Legendre
coefficients of the solution in a step, which decrease like its error: they bound the error of the
polynomial between the stages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import EngineError
from taction.system.progress import reached
from taction.verification.engines.statespace.transients.steps import (
    STAGES,
    TABLE,
    Amplifiers,
    Boards,
    Steps,
)

ITERATIONS = 12  # of the inputs in a step
SHARE = 0.02  # of the tolerance: the last change of the iterations, which leave less
SLOW = 0.2  # contraction above which the next step is linearised anew
LONGEST_JUMP = 3  # levels
SMALLEST, LEVELS = -60, 256  # least level, and the number of levels
LAST_BUT_ONE = 0.2  # weight of the last but one Legendre coefficient in the error
SPREAD = 3.0  # times what rounding made of one draw: what it may make of another one
# Of a change: rounding of the stages' sums over the systems of the method, as random errors add.
SCATTER = EPS / SPREAD * float(np.sqrt(np.abs(TABLE.right) ** 2 @ np.abs(TABLE.left) ** 2).max())
COUNTED = 0.01  # of the tolerance: rounding above it is added up
# Error over last Legendre coefficient of a mode much faster than a step: the stages are all at its
# end, so that the coefficient is half of its change; a mode that rings may be off by twice that.
LAYER = 4.0
RESOLVED = 1.0 / 16.0  # of a coefficient: that of half a step which resolves its modes is 1/256
MAX_STEPS = 1_000_000


@dataclass(eq=False)
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
    failure : str
        Why the integration ended without a solution, or empty.
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
    failure: str = ""

    def checked(self, board: str) -> Dense:
        """Return this output; raise EngineError, with the name of the board, without a solution."""
        if self.failure:
            raise EngineError(f"board {board!r}: {self.failure}; try --engine ngspice")
        return self

    def unresolved(self, whole: Dense) -> float:
        """Return what fast modes can do within steps that are too long for them, V.

        Half the steps of the run `whole` are too long, too, so the difference of the two runs does
        not show it. In a step that resolves its modes half of it has a far smaller coefficient.
        """
        ends, halves = np.array(self.ends), np.zeros(whole.steps)
        within = np.searchsorted(whole.ends, 0.5 * (ends[:-1] + ends[1:])) - 1
        np.maximum.at(halves, within, self.tails)
        passed = halves > RESOLVED * np.array(whole.tails)
        return LAYER * float(halves.max(initial=0.0, where=passed))

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


class Reported(Protocol):
    """The amplifiers of the boards, and what is reported of their watched voltages."""

    amplifiers: Amplifiers

    def volts(self, inputs: Floats) -> Floats:
        """Return reported volts for a volt of each watched voltage, at inputs (R, m, s); (R, W)."""
        ...

    def distance(self, watched: Floats) -> Floats:
        """Return the largest distance of a reported voltage from rest, V, for watched (R, W)."""
        ...

    def part(self, rows: Ints) -> Reported:
        """Return the same of some boards."""
        ...


@dataclass(eq=False)
class Present:
    """Where the boards are; the first axis of every array is that of the boards.

    Attributes
    ----------
    state : ndarray (R, n)
        States of the boards.
    now : ndarray (R, W)
        Watched voltages, inputs first, V.
    slopes : ndarray (R, m)
        At which the steps are linearised, V/V.
    tolerance, unit : ndarray (R,)
        Of one step, and the voltage to which it is relative, V.
    base : ndarray (R,)
        Length of a step of level 0, s.
    limit : ndarray (R,)
        Watched voltage at which the integration ends early (`Dense.escaped`), V.
    """

    state: Any
    now: Floats
    slopes: Floats
    tolerance: Floats
    unit: Floats
    base: Floats
    limit: Floats

    def __post_init__(self) -> None:
        count = len(self.now)
        self.place = np.arange(count)
        self.level = np.zeros(count, dtype=np.int64)
        self.t = np.zeros(count)
        self.stop = np.zeros(count)
        self.far = np.zeros(count)  # largest distance of a reported voltage from rest, V
        self.fresh = np.zeros(count, dtype=np.bool_)  # linearised at the step's own start
        self.noise = np.full((count, LEVELS, self.now.shape[1]), np.nan)

    def keep(self, rows: Ints) -> None:
        """Go on with some of the boards."""
        for name, values in vars(self).items():
            setattr(self, name, values[rows])


class RadauIntegrator:
    """One integration of several boards from t = 0.

    Parameters
    ----------
    board : Boards
        The linear part.
    reported : Reported
        The amplifiers, and what is reported.
    present : Present
        The start.
    """

    def __init__(self, board: Boards, reported: Reported, present: Present) -> None:
        self.board, self.reported, self.present = board, reported, present
        self.amplifiers = reported.amplifiers
        self.out = [Dense() for _ in present.now]
        present.far = reported.distance(present.now)
        self.todo: list[list[int]] | None = None  # levels of the steps to come, where given
        draw = np.random.default_rng(1992)
        self.draws = [draw.standard_normal(x.shape[1]) for x in (present.state, present.slopes)]

    def run(self, stop: Floats, max_steps: int = MAX_STEPS) -> list[Dense]:
        """Integrate to `stop` (R,), s, or beyond it, or until a voltage passes the limit.

        An output has a `failure` where the solution leaves the range of floats or the step
        underflows.
        """
        self.present.stop = np.asarray(stop, dtype=np.float64)
        while len(self.present.place):
            now = self.present
            longest = np.ceil(np.log2((now.stop - now.t) / now.base)).astype(np.int64)
            now.level = np.minimum(now.level, longest)
            self._attempt()
            reached(float((now.t / now.stop).min()))
            self._end(max_steps)
        return self.out

    def repeat(self, levels: Sequence[Sequence[int]]) -> list[Dense]:
        """Take steps of given levels, those of each board.

        A step whose iterations do not converge is taken as two of half its length.
        """
        self.todo = [list(each[::-1]) for each in levels]
        self._end(MAX_STEPS)
        while len(self.present.place):
            places = self.present.place.tolist()
            self.present.level = np.array([self.todo[k][-1] for k in places])
            self._attempt()
            reached(min(1.0 - len(self.todo[k]) / len(levels[k]) for k in places))
            self._end(MAX_STEPS)
        return self.out

    def _end(self, max_steps: int) -> None:
        """Leave out the boards that are done."""
        now, kept = self.present, []
        for row, (place, t, stop) in enumerate(zip(now.place.tolist(), now.t.tolist(),
                                                   now.stop.tolist(), strict=True)):  # fmt: skip
            out = self.out[place]
            if out.failure:
                continue
            if self.todo is not None:
                done = not self.todo[place]
            else:
                done = out.escaped or not t < stop * (1.0 - 1e-12)
                if not done and out.steps > max_steps:
                    out.failure = f"{max_steps} steps did not reach {stop!r} s (now {t!r} s)"
                    done = True
            out.factorisations = self.board.factorisations
            if not done:
                kept.append(row)
        if len(kept) < len(now.place):
            rows = np.array(kept, dtype=np.int64)
            now.keep(rows)
            self.board, self.reported = self.board.part(rows), self.reported.part(rows)
            self.amplifiers = self.reported.amplifiers

    def _attempt(self) -> None:
        """Try one step of every board; boards that accept it move on."""
        now, fixed = self.present, self.todo is not None
        length = now.base * np.exp2(now.level)
        small = (length <= EPS * now.t) | (now.level < SMALLEST)
        for row in np.flatnonzero(small).tolist():
            text = (
                f"no solution after {now.t[row].item()!r} s: steps down to"
                f" {length[row].item():.3g} s have errors above {now.tolerance[row].item():.3g} V"
            )
            self.out[now.place[row]].failure = text
        step = self.board.step(length, now.slopes)
        with np.errstate(invalid="ignore", over="ignore"):
            inputs, remainder, parts, contraction, found = self._iterate(step)
            change, watched = step.end(remainder, inputs, parts)
            watched = now.now[:, :, None] + watched
            piece = np.concatenate([now.now[:, :, None], watched], axis=2) @ TABLE.legendre.T
            gain, left, tail = self._judge(step, piece, watched)
        lost, found = ~found & ~small, found & ~small
        accepted = found & ((gain >= 0) | fixed)
        if lost.any():
            self._repeat_lost(lost)
        slow = accepted & (contraction > SLOW) & ~now.fresh
        self._accept(accepted, length, change, watched, piece, left, tail)
        if slow.any():
            self._linearise(slow, watched[:, : self.amplifiers.count, -1:])
        if not fixed:
            jump = np.clip(gain, -LONGEST_JUMP, LONGEST_JUMP)
            now.level = np.where(found, now.level + jump, now.level)
        now.fresh &= ~accepted

    def _repeat_lost(self, lost: Bools) -> None:
        """Linearise steps whose iterations do not converge anew, then shorten them."""
        now, fresh = self.present, lost & self.present.fresh
        for row in np.flatnonzero(lost).tolist():
            self.out[now.place[row]].rejected += 1
            if self.todo is not None and fresh[row]:
                self.todo[now.place[row]][-1:] = [int(now.level[row]) - 1] * 2
        now.level[fresh] -= 1
        anew = lost & ~fresh
        if anew.any():
            self._linearise(anew, now.now[:, : self.amplifiers.count, None])
        now.fresh[lost] = ~now.fresh[lost]

    def _judge(self, step: Steps, piece: Floats, watched: Floats) -> tuple[Ints, Floats, Floats]:
        """Return by how many levels steps could be longer, what rounding leaves, and the tails.

        Both are in V; the tail is the size of the last Legendre coefficients above rounding.
        """
        now = self.present
        last = np.maximum(np.abs(piece[:, :, -1]), LAST_BUT_ONE * np.abs(piece[:, :, -2]))
        volts = self.reported.volts(watched[:, : self.amplifiers.count])
        # Growing voltages count by their size.
        tolerance = np.maximum(now.tolerance, now.tolerance / now.unit * now.far)
        noise = self._rounding(step, volts)
        size = (last * volts).max(axis=1, initial=0.0)
        tail = np.maximum(size - noise, 0.0)
        error = tail / np.maximum(tolerance, noise)
        gain = np.floor(-np.log2(np.maximum(error, 1e-300)) / STAGES)
        known = np.isfinite(size)
        coarse = known & (noise > tolerance)
        for row in np.flatnonzero(coarse).tolist():
            self.out[now.place[row]].coarse = True
        left = np.where(known & (noise > COUNTED * tolerance), noise, 0.0)
        return np.where(known, gain, -1.0).astype(np.int64), left, np.where(known, tail, 0.0)

    def _rounding(self, step: Steps, volts: Floats) -> Floats:
        """Return what rounding of the states and of the amplifiers makes of the inputs, V, (R,).

        It is measured once for each prepared step.
        """
        now, level = self.present, self.present.level - SMALLEST + 1
        every = np.arange(len(level))
        lacking = np.isnan(now.noise[every, level, 0])
        if lacking.any():
            inputs = now.now[:, : self.amplifiers.count]
            outputs = self.amplifiers.outputs(inputs[:, :, None])[:, :, 0]
            exact = self.board.rate(now.state, inputs, outputs)
            on_state, on_outputs = (1.0 + EPS * draw for draw in self.draws)
            moved = self.board.rate(now.state * on_state, inputs, outputs * on_outputs) - exact
            noise = EPS * np.abs(now.now)
            for rate, share in ((moved, 1.0), (exact, SCATTER)):
                free, parts = step.free(rate)
                end = step.end(np.zeros_like(free), free, parts)[1]
                noise += share * np.abs(end).max(axis=2, initial=0.0)
            now.noise[lacking, level[lacking]] = noise[lacking]
        return np.asarray(SPREAD * (volts * now.noise[every, level]).max(axis=1, initial=0.0))

    def _accept(
        self,
        accepted: Bools,
        length: Floats,
        change: Any,
        watched: Floats,
        piece: Floats,
        left: Floats,
        tail: Floats,
    ) -> None:
        now = self.present
        now.state = np.where(accepted[:, None], now.state + change, now.state)
        now.now = np.where(accepted[:, None], watched[:, :, -1], now.now)
        now.t = np.where(accepted, now.t + length, now.t)
        now.far = self.reported.distance(now.now)
        sizes = [np.abs(x).max(axis=1, initial=0.0) for x in (now.now, now.state)]
        escaped = np.max([*sizes, now.far], axis=0) > now.limit
        for row, yes in enumerate(accepted.tolist()):
            out = self.out[now.place[row]]
            if not yes:
                out.rejected += 1
                continue
            if self.todo is not None:
                self.todo[now.place[row]].pop()
            out.pieces.append(piece[row])
            out.levels.append(int(now.level[row]))
            out.rounding += float(left[row])
            out.tails.append(float(tail[row]))
            out.ends.append(float(now.t[row]))
            out.escaped = bool(escaped[row])

    def _linearise(self, rows: Bools, inputs: Floats) -> None:
        """Linearise the next steps of some boards at inputs (R, m, s), by the mean slopes."""
        slopes = self.amplifiers.slopes(inputs).mean(axis=2)
        rows = rows & np.isfinite(slopes).all(axis=1)
        self.present.slopes = np.where(rows[:, None], slopes, self.present.slopes)
        self.present.noise[rows] = np.nan

    def _iterate(self, step: Steps) -> tuple[Floats, Floats, Any, Floats, Bools]:
        """Find the inputs of all stages, and their remainders, (R, m, s).

        Then follow the parts for `Steps.end`, and how the iterations ended: their contraction, and
        whether they converged, (R,).
        """
        now, m = self.present, self.amplifiers.count
        before_step = now.now[:, :m, None]
        outputs = self.amplifiers.outputs(before_step)
        free, parts = step.free(self.board.rate(now.state, before_step[:, :, 0], outputs[:, :, 0]))
        # At the start of the step there are no remainders: the first iteration gives `free`.
        inputs, remainder, last = free, np.zeros_like(free), np.zeros(len(free))
        volts, slopes = self.reported.volts(before_step), now.slopes[:, :, None]

        def size_of(change: Floats) -> Floats:
            largest = (np.abs(change) * volts[:, :m, None]).max(axis=(1, 2), initial=0.0)
            return np.asarray(largest / now.tolerance)

        before = size_of(free)
        found = before < 1e-4 * SHARE
        going = ~found
        for k in range(1, ITERATIONS):
            if not going.any():
                break
            beyond = self.amplifiers.outputs(before_step + inputs) - outputs - slopes * inputs
            going &= np.isfinite(beyond).all(axis=(1, 2))
            beyond = np.where(going[:, None, None], beyond, remainder)
            following = free + step.response(beyond, parts)
            size = size_of(following - inputs)
            going &= np.isfinite(size)
            contraction = size / np.where(going, before, 1.0)
            inputs = np.where(going[:, None, None], following, inputs)
            remainder = np.where(going[:, None, None], beyond, remainder)
            # No forecast of what is left: beyond a knee of an amplifier convergence is uneven.
            done = going & (contraction < 1.0) & (size < SHARE)
            last = np.where(done, contraction, last)
            stuck = going & ~done & ((contraction >= 1.0) | (k == ITERATIONS - 1))
            if stuck.any():
                done |= stuck & (size * now.tolerance <= self._rounding(step, volts))
            found |= done
            going &= ~(done | stuck)
            before = size
        return inputs, remainder, parts, last, found
