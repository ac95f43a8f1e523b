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


@dataclass(slots=True, eq=False)
class StageValues:
    """What the iterations found in a step: inputs and remainders of all stages, (R, m, s).

    `parts` are for `Steps.end`; `contraction` and `found` (R,) say how the iterations ended.
    """

    inputs: Floats
    remainder: Floats
    parts: Any
    contraction: Floats
    found: Bools


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
        for row in np.flatnonzero(small).tolist() if small.any() else ():
            text = (
                f"no solution after {now.t[row].item()!r} s: steps down to"
                f" {length[row].item():.3g} s have errors above {now.tolerance[row].item():.3g} V"
            )
            self.out[now.place[row]].failure = text
        step = self.board.step(length, now.slopes)
        with np.errstate(invalid="ignore", over="ignore"):
            stages = self._iterate(step)
            change, watched = step.end(stages.remainder, stages.inputs, stages.parts)
            watched = now.now[:, :, None] + watched
            piece = np.concatenate([now.now[:, :, None], watched], axis=2) @ TABLE.legendre.T
            gain, left, tail = self._judge(step, piece, watched)
        found = stages.found & ~small
        accepted = found & ((gain >= 0) | fixed)
        if not found.all():
            self._repeat_lost(~stages.found & ~small)
        slow = accepted & (stages.contraction > SLOW) & ~now.fresh
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
        for row in np.flatnonzero(coarse).tolist() if coarse.any() else ():
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
            rows = np.flatnonzero(lacking)
            m, board, part = self.amplifiers.count, self.board.part(rows), step.part(rows)
            state, voltages = now.state[rows], now.now[rows]
            inputs = voltages[:, :m]
            outputs = self.reported.part(rows).amplifiers.outputs(inputs[:, :, None])[:, :, 0]
            exact = board.rate(state, inputs, outputs)
            on_state, on_outputs = (1.0 + EPS * draw for draw in self.draws)
            moved = board.rate(state * on_state, inputs, outputs * on_outputs) - exact
            zero, noise = np.zeros((len(rows), m, STAGES)), EPS * np.abs(voltages)
            for rate, share in ((moved, 1.0), (exact, SCATTER)):
                free, parts = part.free(rate)
                noise += share * np.abs(part.end(zero, free, parts)[1]).max(axis=2)
            now.noise[rows, level[rows]] = noise
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
        if accepted.all():
            now.state, now.now, now.t = now.state + change, watched[:, :, -1], now.t + length
        else:
            now.state = np.where(accepted[:, None], now.state + change, now.state)
            now.now = np.where(accepted[:, None], watched[:, :, -1], now.now)
            now.t = np.where(accepted, now.t + length, now.t)
        now.far = self.reported.distance(now.now)
        largest = np.maximum(np.abs(now.now).max(axis=1, initial=0.0), self.board.size(now.state))
        escaped = np.maximum(largest, now.far) > now.limit
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

    def _iterate(self, step: Steps) -> StageValues:
        """Find the inputs of all stages."""
        now, m, count = self.present, self.amplifiers.count, len(self.present.place)
        inputs_now = now.now[:, :m, None]
        outputs = self.amplifiers.outputs(inputs_now)
        free, parts = step.free(self.board.rate(now.state, inputs_now[:, :, 0], outputs[:, :, 0]))
        zero, every = np.zeros((count, m, STAGES)), np.ones(count, dtype=np.bool_)
        # At the start of the step there are no remainders: the first iteration gives `free`.
        found = StageValues(free, zero, parts, np.zeros(count), every)
        if not m:
            return found
        all_volts, slopes = self.reported.volts(inputs_now), now.slopes[:, :, None]
        volts = all_volts[:, :m, None]

        def size_of(change: Floats) -> Floats:
            return np.asarray((np.abs(change) * volts).max(axis=(1, 2)) / now.tolerance)

        before = size_of(free)
        found.found = before < 1e-4 * SHARE
        going = ~found.found
        for k in range(1, ITERATIONS):
            if not going.any():
                break
            change = self.amplifiers.outputs(inputs_now + found.inputs) - outputs
            remainder = change - slopes * found.inputs
            going &= np.isfinite(remainder).all(axis=(1, 2))
            if not going.all():
                remainder = np.where(going[:, None, None], remainder, found.remainder)
            following = free + step.response(remainder, parts)
            size = size_of(following - found.inputs)
            going &= np.isfinite(size)
            contraction = size / np.where(going, before, 1.0)
            if not going.all():
                following = np.where(going[:, None, None], following, found.inputs)
                remainder = np.where(going[:, None, None], remainder, found.remainder)
            found.inputs, found.remainder = following, remainder
            # No forecast of what is left: beyond a knee of an amplifier convergence is uneven.
            done = going & (contraction < 1.0) & (size < SHARE)
            found.contraction = np.where(done, contraction, found.contraction)
            stuck = going & ~done & ((contraction >= 1.0) | (k == ITERATIONS - 1))
            if stuck.any():
                done |= stuck & (size * now.tolerance <= self._rounding(step, all_volts))
            found.found |= done
            going &= ~(done | stuck)
            before = size
        return found
