"""The integrator of everything that has no exact solution: Radau IIA steps, dense output, events.

A board is ``M x' = K x + b + F a(v)`` with inputs ``v = G x + H a(v)`` of m amplifiers. From the
start of a step on, K contains the amplifiers' slopes, and only what an amplifier does beyond its
slope is nonlinear: the remainder n. In the eigenbasis of the method's matrix the changes w of the s
stages since the start are separate systems

    (theta_k M / h - K) w_k = sigma_k r + F nu_k,

half of them by symmetry, where r is the rate at the start and nu are the remainders n of the stages
in this basis. So a step of a linear board needs no iteration, and the stages of any other board are
found by iterating on the m inputs alone. `modal_steps` have these systems in the basis of the
modes, where they are divisions, `structured_steps` solve them in all unknowns.

Several boards are integrated at a time, each with steps of its own: they only share the array
operations. Each iteration is a simplified Newton step, whose slopes are kept over steps until
convergence is slow. The lengths of steps are powers of two. The length follows from the last
Legendre coefficients of the solution in a step, which decrease like its error: they bound the error
of the polynomial between the stages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.verification.engines.statespace.transients.modal_steps import ModalBoards
from taction.verification.engines.statespace.transients.radau import STAGES, TABLE
from taction.verification.engines.statespace.transients.straight_pieces import (
    JUMPS,
    MOST_SWITCHES,
    PASSED,
    ROUNDED,
    SLACK,
    Batch,
    Switch,
    first_passage,
    shortened,
)
from taction.verification.engines.statespace.transients.structured_steps import StructuredBoard

ITERATIONS = 12  # of the inputs in a step
SHARE = 0.02  # of the tolerance: the last change of the iterations, which leave less
SLOW = 0.2  # contraction above which the next step is linearised anew
LONGEST_JUMP = 3  # levels
SMALLEST, LEVELLESS = -60, 10**6  # least level, and none
LAST_BUT_ONE = 0.2  # weight of the last but one Legendre coefficient in the error
SPREAD = 4.0  # times what rounding made of one draw: what it may make of another one
# Of a change: rounding of the stages' sums over the systems of the method, as random errors add.
SCATTER = EPS * float(np.sqrt(np.abs(TABLE.right) ** 2 @ np.abs(TABLE.left) ** 2).max())
COUNTED = 0.01  # of the tolerance: rounding above it is added up
TINY = 1e-300
MAX_STEPS = 1_000_000


@dataclass(eq=False)
class Integration(Batch):
    """Boards of one kind on their way from t = 0; arrays have the boards on their first axis."""

    board: ModalBoards | StructuredBoard  # the linear part
    reported: Any  # the amplifiers, and what is reported of the watched voltages
    out: NDArray[np.object_]  # (R,): the solutions, to which steps are added
    # (R,): integrations of the same boards: steps are at most half as long as theirs, and none is
    # refused for its error. Where None the tolerance decides.
    whole: NDArray[np.object_]
    state: Any  # (R, n): states of the boards
    now: Floats  # (R, W): watched voltages, inputs first, V
    slopes: Floats  # (R, m): at which the steps are linearised, V/V
    # `tolerance`, `unit`: (R,): of one step, and the voltage to which it is relative, V.
    tolerance: Floats
    unit: Floats
    base: Floats  # (R,): length of a step of level 0, s
    limit: Floats  # (R,): watched voltage at which the integration ends early (`Dense.escaped`), V
    stop: Floats  # (R,): where the integration ends, s

    def __post_init__(self) -> None:
        count, self.amplifiers = len(self.now), self.reported.amplifiers
        self.level, self.t = np.zeros(count, dtype=np.int64), np.zeros(count)
        self.segments = np.zeros(self.slopes.shape, dtype=np.int64)  # straight pieces of inputs
        self.slack = np.ones(self.slopes.shape)  # of a break, V
        self.probed = np.full(count, LEVELLESS)  # the level of a step at which `noise` was measured
        self.noise = np.zeros(self.now.shape)  # what rounding makes of the watched voltages, V
        self.far = self.reported.distance(self.now)  # a reported voltage from rest, V

    def run(self, max_steps: int = MAX_STEPS) -> None:
        """Integrate to `stop` or beyond it, or until a voltage passes the limit.

        An output has a `failure` where the solution leaves the range of floats, the step
        underflows, or there are more than `max_steps` or `MOST_SWITCHES`.
        """
        self._find_pieces()
        work = self._left(max_steps)
        while len(work.t):
            work._attempt()
            work = work._left(max_steps)

    def _left(self, max_steps: int) -> Integration:
        """Return the boards that have not ended."""
        kept = []
        for row, out in enumerate(self.out):
            t, stop = self.t[row].item(), self.stop[row].item()
            out.factorisations = self.board.factorisations
            if out.failure or out.escaped or not t < stop * (1.0 - 1e-12):
                continue
            if out.steps > max_steps:
                out.failure = f"{max_steps} steps did not reach {stop!r} s (now {t!r} s)"
            elif len(out.switches) > MOST_SWITCHES:
                out.failure = (
                    f"the amplifiers switch more than {MOST_SWITCHES} times before {t:.3g} s; a"
                    " shorter analysis.stop ends the record earlier"
                )
            else:
                kept.append(row)
        return self if len(kept) == len(self.t) else self.take(np.array(kept, dtype=np.int64))

    def _find_pieces(self) -> None:
        """Find the straight pieces of the start."""
        amplifiers, pieces = self.amplifiers, self.amplifiers.pieces
        if not pieces.broken.any():
            return
        scale, inputs = amplifiers.v_scale[:, :, 0], self.now[:, : amplifiers.count]
        self.segments = pieces.at(inputs / scale)
        size = np.maximum(np.abs(inputs), scale).max(axis=1, keepdims=True)
        steepest = np.maximum(amplifiers.steepest(), TINY)
        self.slack = np.maximum(SLACK * self.tolerance[:, None] / steepest, ROUNDED * size)
        self._begin_pieces(np.ones(len(size), dtype=np.bool_))

    def _begin_pieces(self, rows: Bools) -> None:
        """Linearise boards that begin on other straight pieces."""
        self._linearise(rows[:, None] & self.amplifiers.pieces.broken)
        jumping = self.board.jumping(self.slopes)
        for row in np.flatnonzero(rows).tolist():
            out, segments = self.out[row], tuple(self.segments[row].tolist())
            out.switches.append(Switch(float(self.t[row]), segments))
            if jumping[row]:
                out.failure = JUMPS

    def _linearise(self, places: Bools) -> None:
        """Linearise the next steps at the present inputs, for amplifiers at `places` (R, m)."""
        slopes = self.amplifiers.slopes_along(self.now[:, : self.slopes.shape[1]], self.segments)
        self.slopes = np.where(places & np.isfinite(slopes), slopes, self.slopes)
        self.probed = np.where(places.any(axis=1), LEVELLESS, self.probed)

    def _levels(self) -> tuple[Ints, Bools]:
        """Return the levels of the next steps, and which are given by another integration."""
        level = np.ceil(np.log2((self.stop - self.t) / self.base)).astype(np.int64)
        level = np.minimum(self.level, level)
        given = np.array([whole is not None for whole in self.whole], dtype=np.bool_)
        for row in np.flatnonzero(given).tolist():
            most = self.whole[row].level_within(self.t[row].item(), self.base[row].item()) - 1
            level[row] = min(int(self.level[row]), most)
        return level, given

    def _attempt(self) -> None:
        """Try one step of every board; boards that accept it move on."""
        self.level, given = self._levels()
        length = self.base * np.exp2(self.level)
        small = (length <= EPS * self.t) | (self.level < SMALLEST)
        for row in np.flatnonzero(small).tolist():
            self.out[row].failure = (
                f"no solution after {self.t[row].item()!r} s: steps down to"
                f" {length[row].item():.3g} s have errors above {self.tolerance[row].item():.3g} V"
            )
        self.board.prepare(length, self.slopes)
        with np.errstate(invalid="ignore", over="ignore"):
            start = self.now[:, : self.slopes.shape[1]]
            outputs = self.amplifiers.along(start[:, :, None], self.segments)
            rate: Any = self.board.rate(self.state, start, outputs[:, :, 0])
            noise = self._rounding(rate, start, outputs[:, :, 0])
            inputs, remainder, parts, contraction, found = self._iterate(rate, outputs, noise)
            found &= ~small
            parts, change = self.board.end(remainder, inputs, parts)
            watched = self.now[:, :, None] + change
            piece = np.concatenate([self.now[:, :, None], watched], axis=2) @ TABLE.legendre.T
            gain, rounding, tail = self._judge(piece, watched, noise)
            gain = np.where(given, LONGEST_JUMP, gain)
            accepted = found & (gain >= 0)
            weights = np.repeat(TABLE.right[-1:], len(length), axis=0)
            moves = self._passages(accepted, length, piece, watched, weights)
            moved = self.board.moved(parts, weights)
        self.state = np.where(accepted[:, None], self.state + moved, self.state)
        self.now = np.where(accepted[:, None], watched[:, :, -1], self.now)
        self.t = np.where(accepted, self.t + length, self.t)
        self._record(accepted, piece, rounding, tail)
        if moves.any():
            self.segments = self.segments + moves
            self._begin_pieces(np.asarray(moves.any(axis=1)))
        slow = ~found | (accepted & (contraction > SLOW))
        if slow.any():
            self._linearise(slow[:, None] & np.ones(self.slopes.shape, dtype=np.bool_))
        self.level = self.level + np.where(found, np.clip(gain, -LONGEST_JUMP, LONGEST_JUMP), -1)

    def _passages(
        self, accepted: Bools, length: Floats, piece: Floats, watched: Floats, weights: Any
    ) -> Ints:
        """End accepted steps where an input leaves its straight piece; all arrays change in place.

        Return by how many pieces each input moves, (R, m).
        """
        m, moves = self.slopes.shape[1], np.zeros_like(self.segments)
        if not self.amplifiers.pieces.broken.any():
            return moves
        scale = self.amplifiers.v_scale[:, :, 0]
        low, high = (scale * x / self.slack for x in self.amplifiers.pieces.ends(self.segments))
        y = piece[:, :m] / self.slack[:, :, None]
        excess = np.concatenate([y, -y], axis=1)
        excess[:, :, 0] -= np.concatenate([high, -low], axis=1) + 1.0
        for row in np.flatnonzero(accepted).tolist():
            theta = first_passage(excess[row])
            if theta == 1.0:
                continue
            piece[row], watched[row, :, -1], weights[row] = shortened(piece[row], theta)
            length[row] *= theta
            inputs = watched[row, :m, -1] / self.slack[row]
            moves[row] += inputs > high[row] + PASSED
            moves[row] -= inputs < low[row] - PASSED
        return moves

    def _rounding(self, rate: Any, inputs: Floats, outputs: Floats) -> Floats:
        """Return what rounding of the states and of the amplifiers makes of the watched voltages.

        In V, (R, W). It is measured once for each level of steps, by a change of both.
        """
        lacking = self.probed != self.level
        if lacking.any():
            draw = np.random.default_rng(1992)
            near, driven = (
                x * (1.0 + EPS * draw.standard_normal(x.shape[1])) for x in (self.state, outputs)
            )
            moved = SPREAD * (self.board.rate(near, inputs, driven) - rate)
            noise = SPREAD * EPS * np.abs(self.now)
            for change in (moved, SCATTER * rate):
                free, parts = self.board.free(change)
                watched = self.board.end(np.zeros_like(free), free, parts)[1]
                noise += np.abs(watched).max(axis=2, initial=0.0)
            self.noise = np.where(lacking[:, None], noise, self.noise)
            self.probed = self.level
        return self.noise

    def _judge(self, piece: Floats, watched: Floats, noise: Floats) -> tuple[Ints, Floats, Floats]:
        """Return by how many levels steps could be longer, what rounding leaves, and the tails.

        Both are in V; the tail is the size of the last Legendre coefficients above rounding.
        """
        last = np.maximum(np.abs(piece[:, :, -1]), LAST_BUT_ONE * np.abs(piece[:, :, -2]))
        volts = self.reported.volts(watched[:, : self.slopes.shape[1]])
        # Growing voltages count by their size.
        tolerance = np.maximum(self.tolerance, self.tolerance / self.unit * self.far)
        size, rounding = (np.max(volts * x, axis=1, initial=0.0) for x in (last, noise))
        tail = np.maximum(size - rounding, 0.0)
        gain = np.floor(-np.log2(np.maximum(tail / np.maximum(tolerance, rounding), TINY)) / STAGES)
        counted = np.where(rounding > COUNTED * tolerance, rounding, 0.0)
        return np.where(np.isfinite(size), gain, -1.0).astype(np.int64), counted, tail

    def _record(self, accepted: Bools, piece: Floats, rounding: Floats, tail: Floats) -> None:
        """Add the accepted steps to the solutions."""
        self.far = self.reported.distance(self.now)
        sizes = [np.abs(x).max(axis=1, initial=0.0) for x in (self.now, self.state)]
        escaped = np.max([*sizes, self.far], axis=0) > self.limit
        for row in np.flatnonzero(accepted).tolist():
            out = self.out[row]
            if self.t[row] > out.ends[-1]:  # else it ended at once, at a break
                out.pieces.append(piece[row])
                out.levels.append(int(self.level[row]))
                out.ends.append(float(self.t[row]))
            out.rounding += float(rounding[row])
            out.tail = max(out.tail, float(tail[row]))
            out.escaped = bool(escaped[row])

    def _iterate(
        self, rate: Any, outputs: Floats, noise: Floats
    ) -> tuple[Floats, Floats, Any, Floats, Bools]:
        """Find the inputs of all stages, and their remainders, (R, m, s).

        Then follow the parts for the end of the step, and how the iterations ended: their
        contraction, and whether they converged, (R,). Rates and outputs (R, m, 1) of the amplifiers
        are those at the start of the step, `noise` is rounding, V, (R, W).
        """
        m, along = self.slopes.shape[1], self.amplifiers.along
        start, pieces = self.now[:, :m, None], self.segments
        slopes = self.slopes[:, :, None]
        # At the start of the step there are no remainders: the first iteration gives `free`.
        free, parts = self.board.free(rate)
        inputs, remainder, last = free, np.zeros_like(free), np.zeros(len(free))
        volts = self.reported.volts(start)[:, :m, None] / self.tolerance[:, None, None]

        def size_of(change: Floats) -> Floats:
            return np.asarray((np.abs(change) * volts).max(axis=(1, 2), initial=0.0))

        floor, before = size_of(noise[:, :m, None]), size_of(free)
        found = before < 1e-4 * SHARE
        going = ~found
        for k in range(1, ITERATIONS):
            if not going.any():
                break
            beyond = along(start + inputs, pieces) - outputs - slopes * inputs
            going &= np.isfinite(beyond).all(axis=(1, 2))
            remainder = np.where(going[:, None, None], beyond, remainder)
            following = free + self.board.response(remainder, parts)
            size = size_of(following - inputs)
            going &= np.isfinite(size)
            contraction = size / np.where(going, before, 1.0)
            inputs = np.where(going[:, None, None], following, inputs)
            # No forecast of what is left: beyond a knee of an amplifier convergence is uneven.
            done = going & (contraction < 1.0) & (size < SHARE)
            last = np.where(done, contraction, last)
            stuck = going & ~done & ((contraction >= 1.0) | (k == ITERATIONS - 1))
            found |= done | (stuck & (size <= floor + SCATTER * size_of(inputs)))
            going &= ~(done | stuck)
            before = size
        return inputs, remainder, parts, last, found
