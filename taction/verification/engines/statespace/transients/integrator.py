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
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.progress import reached
from taction.verification.engines.statespace.transients.dense import Dense
from taction.verification.engines.statespace.transients.radau import STAGES, TABLE
from taction.verification.engines.statespace.transients.steps import Amplifiers, Boards, Steps
from taction.verification.engines.statespace.transients.straight_pieces import (
    JUMPS,
    MOST_SWITCHES,
    PASSED,
    ROUNDED,
    SLACK,
    Switch,
    first_passage,
    hull,
    shortened,
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
TINY = 1e-300
COUNTED = 0.01  # of the tolerance: rounding above it is added up
MAX_STEPS = 1_000_000


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
        self.segments = np.zeros(self.slopes.shape, dtype=np.int64)  # straight pieces of inputs
        self.slack = np.ones(self.slopes.shape)  # of a break, V
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
        self.caps: Sequence[Dense] = ()  # integrations whose steps are at least twice as long
        self.most_switches = MOST_SWITCHES
        draw = np.random.default_rng(1992)
        self.draws = [draw.standard_normal(x.shape[1]) for x in (present.state, present.slopes)]
        self._find_pieces()

    def _find_pieces(self) -> None:
        """Find the straight pieces of the start."""
        now, amplifiers, pieces = self.present, self.amplifiers, self.amplifiers.pieces
        if pieces is None:
            return
        scale, inputs = amplifiers.v_scale[:, :, 0], now.now[:, : amplifiers.count]
        now.segments = pieces.at(inputs / scale)
        size = np.maximum(np.abs(inputs), scale).max(axis=1, keepdims=True)
        steepest = np.maximum(amplifiers.steepest(), TINY)
        now.slack = np.maximum(SLACK * now.tolerance[:, None] / steepest, ROUNDED * size)
        self._begin_pieces(np.ones(len(size), dtype=np.bool_), inputs[:, :, None])

    def _begin_pieces(self, rows: Bools, inputs: Floats) -> None:
        """Linearise boards that begin on other straight pieces, at inputs (R, m, 1)."""
        now = self.present
        self._linearise(rows, inputs, only_pieces=True)
        jumping = self.board.jumping(now.slopes)
        for row in np.flatnonzero(rows).tolist():
            out = self.out[now.place[row]]
            segments = tuple(now.segments[row].tolist())
            out.switches.append(Switch(float(now.t[row]), segments, now.state[row].copy()))
            if jumping[row]:
                out.failure = JUMPS
            elif len(out.switches) > self.most_switches:
                out.failure = (
                    f"the amplifiers switch more than {self.most_switches} times before"
                    f" {now.t[row].item():.3g} s; a shorter analysis.stop ends the record earlier"
                )

    def run(self, stop: Floats, max_steps: int = MAX_STEPS) -> list[Dense]:
        """Integrate to `stop` (R,), s, or beyond it, or until a voltage passes the limit.

        An output has a `failure` where the solution leaves the range of floats or the step
        underflows.
        """
        self.present.stop = np.asarray(stop, dtype=np.float64)
        self._end(max_steps)
        while len(self.present.place):
            now = self.present
            longest = np.ceil(np.log2((now.stop - now.t) / now.base)).astype(np.int64)
            now.level = np.minimum(now.level, longest)
            if self.caps:
                pairs = zip(now.place.tolist(), now.t.tolist(), strict=True)
                most = [self.caps[place].level_at(t) - 1 for place, t in pairs]
                now.level = np.minimum(now.level, most)
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
            parts, watched = step.end(remainder, inputs, parts)
            watched = now.now[:, :, None] + watched
            piece = np.concatenate([now.now[:, :, None], watched], axis=2) @ TABLE.legendre.T
            gain, left, tail = self._judge(step, piece, watched)
            lost, found = ~found & ~small, found & ~small
            accepted = found & ((gain >= 0) | fixed)
            weights = np.repeat(TABLE.right[-1:], len(length), axis=0)
            moves = self._passages(accepted, length, piece, watched, weights)
            change = step.moved(parts, weights)
        if lost.any():
            self._repeat_lost(lost)
        slow = accepted & (contraction > SLOW) & ~now.fresh
        self._accept(accepted, length, change, watched, piece, left, tail)
        inputs = watched[:, : self.amplifiers.count, -1:]
        if moves.any():
            now.segments = now.segments + moves
            self._begin_pieces(np.asarray(moves.any(axis=1)), inputs)
        if slow.any():
            self._linearise(slow, inputs)
        if not fixed:
            jump = np.clip(gain, -LONGEST_JUMP, LONGEST_JUMP)
            now.level = np.where(found, now.level + jump, now.level)
        now.fresh &= ~accepted

    def _passages(
        self, accepted: Bools, length: Floats, piece: Floats, watched: Floats, weights: Any
    ) -> Ints:
        """End accepted steps where an input leaves its straight piece; all arrays change in place.

        Return by how many pieces each input moves, (R, m).
        """
        now, m, moves = self.present, self.amplifiers.count, np.zeros_like(self.present.segments)
        if self.amplifiers.pieces is None:
            return moves
        scale = self.amplifiers.v_scale[:, :, 0]
        ends = [scale * end / now.slack for end in self.amplifiers.pieces.ends(now.segments)]
        scaled = piece[:, :m] / now.slack[:, :, None]
        y = hull(scaled)
        excess = np.concatenate(
            [y - (ends[1] + 1.0)[:, :, None], (ends[0] - 1.0)[:, :, None] - y], axis=1
        )
        for row in np.flatnonzero(accepted & (excess > 0.0).any(axis=(1, 2))).tolist():
            theta = first_passage(excess[row])
            if theta == 1.0 and not (excess[row, :, -1] > 0.0).any():
                continue
            piece[row], watched[row, :, -1], weights[row] = shortened(piece[row], theta)
            length[row] *= theta
            inputs = watched[row, :m, -1] / now.slack[row]
            moves[row] += inputs > ends[1][row] + PASSED
            moves[row] -= inputs < ends[0][row] - PASSED
        return moves

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
            if now.t[row] > out.ends[-1]:  # else it ended at once, at a break
                out.pieces.append(piece[row])
                out.levels.append(int(now.level[row]))
                out.tails.append(float(tail[row]))
                out.ends.append(float(now.t[row]))
            out.rounding += float(left[row])
            out.escaped = bool(escaped[row])

    def _linearise(self, rows: Bools, inputs: Floats, *, only_pieces: bool = False) -> None:
        """Linearise the next steps of some boards at inputs (R, m, s), by the mean slopes."""
        pieces = self.amplifiers.pieces
        if pieces is None:
            slopes = self.amplifiers.slopes(inputs).mean(axis=2)
        else:
            slopes = self.amplifiers.slopes_along(inputs, self.present.segments)
            if only_pieces:
                slopes = np.where(pieces.broken, slopes, self.present.slopes)
        rows = rows & np.isfinite(slopes).all(axis=1)
        self.present.slopes = np.where(rows[:, None], slopes, self.present.slopes)
        self.present.noise[rows] = np.nan

    def _iterate(self, step: Steps) -> tuple[Floats, Floats, Any, Floats, Bools]:
        """Find the inputs of all stages, and their remainders, (R, m, s).

        Then follow the parts for `Steps.end`, and how the iterations ended: their contraction, and
        whether they converged, (R,).
        """
        now, m = self.present, self.amplifiers.count
        before_step, pieces = now.now[:, :m, None], now.segments
        outputs = self.amplifiers.along(before_step, pieces)
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
            beyond = self.amplifiers.along(before_step + inputs, pieces) - outputs - slopes * inputs
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
