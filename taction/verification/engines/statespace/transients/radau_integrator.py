"""The integrator of everything that has no exact solution: Radau IIA steps, dense output, events.

A board is ``M x' = K x + b + F a(v)`` with inputs ``v = G x + H a(v)`` of m amplifiers. From the
start of a step on, K contains the amplifiers' slopes, and only what an amplifier does beyond its
slope is nonlinear: the remainder n. In the eigenbasis of the method's matrix the changes w of the s
stages since the start are separate systems

    (theta_k M / h - K) w_k = sigma_k r + F nu_k,

half of them by symmetry, where r is the rate at the start and nu are the remainders n of the stages
in this basis. So a step of a linear board needs no iteration, and the stages of any other board are
found by iterating on the m inputs alone. `step_systems` has these systems in the basis of the
modes, where they are divisions, and solves them in all unknowns of a large board.

Each iteration is a simplified Newton step, whose slopes are kept over steps until convergence is
slow. The lengths of steps are powers of two. The length follows from the last Legendre coefficients
of the solution in a step, which decrease like its error: they bound the error of the polynomial
between the stages.

Where the straight pieces of an amplifier meet, the solution bends, and steps are short. The
right-hand side of a board with a continuous g is Lipschitz continuous, so one solution passes
through every state. Only an amplifier that drives its own input without any delay, by a gain above
1, makes the equations ambiguous, as a Schmitt trigger's are; `JUMPS` refuses what comes near that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.verification.engines.statespace.transients.radau import STAGES, TABLE, Dense
from taction.verification.engines.statespace.transients.step_systems import (
    ModalBoard,
    StructuredBoard,
)

ITERATIONS = 12  # of the inputs in a step
SHARE = 0.02  # of the tolerance: the last change of the iterations, which leave less
SLOW = 0.2  # contraction above which the next step is linearised anew
LONGEST_JUMP = 3  # levels
SMALLEST = -60  # least level
JUMPS = (
    "some of its amplifiers drive their own inputs without delay, by a gain above 1/2: the board"
    " may have several voltages for one state, and jump. Give the op-amps a bandwidth, or the"
    " signal nodes a capacitance"
)
LAST_BUT_ONE = 0.2  # weight of the last but one Legendre coefficient in the error
SPREAD = 4.0  # times what rounding made of one draw: what it may make of another one
# Of a change: rounding of the stages' sums over the systems of the method, as random errors add.
SCATTER = EPS * float(np.sqrt(np.abs(TABLE.right) ** 2 @ np.abs(TABLE.left) ** 2).max())
COUNTED = 0.01  # of the tolerance: rounding above it is added up
TINY = 1e-300
MAX_STEPS = 1_000_000


@dataclass(eq=False)
class Integration:
    """A board on its way from t = 0."""

    board: ModalBoard | StructuredBoard  # the linear part
    reported: Any  # the amplifiers, and what is reported of the watched voltages
    # An integration of the same board: steps are at most half as long as its own, and none is
    # refused for its error. Where None the tolerance decides.
    whole: Dense | None
    state: Any  # (n,): state of the board
    now: Floats  # (W,): watched voltages, inputs first, V
    slopes: Floats  # (m,): at which the steps are linearised, V/V
    # `tolerance`, `unit`: of one step, and the voltage to which it is relative, V.
    tolerance: float
    unit: float
    base: float  # length of a step of level 0, s
    limit: float  # watched voltage at which the integration ends early (`Dense.escaped`), V
    stop: float  # where the integration ends, s

    def __post_init__(self) -> None:
        self.out, self.devices = Dense(), self.reported.devices
        self.level, self.t = 0, 0.0
        self.probed: int | None = None  # the level of a step at which `noise` was measured
        self.noise = np.zeros(self.now.shape)  # what rounding makes of the watched voltages, V
        self.far = self.reported.distance(self.now)  # a reported voltage from rest, V

    def run(self, max_steps: int = MAX_STEPS) -> None:
        """Integrate to `stop` or beyond it, or until a voltage passes the limit.

        The output has a `failure` where the solution leaves the range of floats, the step
        underflows, or there are more than `max_steps`.
        """
        out = self.out
        if self.devices.steepest.any() and self.board.jumping(self.devices.steepest):
            out.failure = JUMPS
        while not (out.failure or out.escaped) and self.t < self.stop * (1.0 - 1e-12):
            if out.steps > max_steps:
                out.failure = f"{max_steps} steps did not reach {self.stop!r} s (now {self.t!r} s)"
            else:
                self._attempt()
        out.factorisations = self.board.factorisations

    def _linearise(self) -> None:
        """Linearise the next steps at the present inputs."""
        slopes = self.devices.slopes(self.now[: len(self.slopes), None])[:, 0]
        self.slopes = np.where(np.isfinite(slopes), slopes, self.slopes)
        self.probed = None

    def _attempt(self) -> None:
        """Try one step; if it is accepted, the board moves on."""
        own, m = self.level, len(self.slopes)
        self.level = min(own, math.ceil(math.log2((self.stop - self.t) / self.base)))
        if self.whole is not None:
            self.level = min(own, self.whole.level_within(self.t, self.base) - 1)
        length = self.base * 2.0**self.level
        if length <= EPS * self.t or self.level < SMALLEST:
            self.out.failure = (
                f"no solution after {self.t!r} s: steps down to {length:.3g} s have errors above"
                f" {self.tolerance:.3g} V"
            )
            return
        self.board.prepare(length, self.slopes)
        with np.errstate(invalid="ignore", over="ignore"):
            start = self.now[:m]
            outputs = self.devices.outputs(start[:, None])
            rate: Any = self.board.rate(self.state, start, outputs[:, 0])
            noise = self._rounding(rate, start, outputs[:, 0])
            inputs, remainder, parts, contraction, found = self._iterate(rate, outputs, noise)
            parts, change = self.board.end(remainder, inputs, parts)
            watched = self.now[:, None] + change
            piece = np.concatenate([self.now[:, None], watched], axis=1) @ TABLE.legendre.T
            gain, rounding, tail = self._judge(piece, watched, noise)
            if self.whole is not None:
                gain = LONGEST_JUMP
            accepted = found and gain >= 0
            if accepted:
                self.state = self.state + self.board.moved(parts, TABLE.right[-1])
                self.now, self.t = watched[:, -1], self.t + length
                self._record(piece, rounding, tail)
        if not found or (accepted and contraction > SLOW):
            self._linearise()
        self.level += max(-LONGEST_JUMP, min(gain, LONGEST_JUMP)) if found else -1

    def _rounding(self, rate: Any, inputs: Floats, outputs: Floats) -> Floats:
        """Return what rounding of the state and of the amplifiers makes of the watched voltages.

        In V, (W,). It is measured once for each level of steps, by a change of both.
        """
        if self.probed != self.level:
            draw = np.random.default_rng(1992)
            near = self.state * (1.0 + EPS * draw.standard_normal(len(self.state)))
            driven = outputs * (1.0 + EPS * draw.standard_normal(len(outputs)))
            moved = SPREAD * (self.board.rate(near, inputs, driven) - rate)
            self.noise = SPREAD * EPS * np.abs(self.now)
            for change in (moved, SCATTER * rate):
                free, parts = self.board.free(change)
                watched = self.board.end(np.zeros_like(free), free, parts)[1]
                self.noise = self.noise + np.abs(watched).max(axis=1, initial=0.0)
            self.probed = self.level
        return self.noise

    def _judge(self, piece: Floats, watched: Floats, noise: Floats) -> tuple[int, float, float]:
        """Return by how many levels the step could be longer, what rounding leaves, and the tail.

        Both are in V; the tail is the size of the last Legendre coefficients above rounding.
        """
        last = np.maximum(np.abs(piece[:, -1]), LAST_BUT_ONE * np.abs(piece[:, -2]))
        volts = self.reported.volts(watched[: len(self.slopes)])
        # Growing voltages count by their size.
        tolerance = max(self.tolerance, self.tolerance / self.unit * self.far)
        size, rounding = (float((volts * x).max(initial=0.0)) for x in (last, noise))
        counted = rounding if rounding > COUNTED * tolerance else 0.0
        tail = max(size - rounding, 0.0)
        if not math.isfinite(size):
            return -1, counted, tail
        ratio = max(tail / max(tolerance, rounding), TINY)
        return math.floor(-math.log2(ratio) / STAGES), counted, tail

    def _record(self, piece: Floats, rounding: float, tail: float) -> None:
        """Add the accepted step to the solution."""
        out, self.far = self.out, self.reported.distance(self.now)
        out.pieces.append(piece)
        out.levels.append(self.level)
        out.ends.append(self.t)
        out.rounding += rounding
        out.tail = max(out.tail, tail)
        sizes = (float(np.abs(x).max(initial=0.0)) for x in (self.now, self.state))
        out.escaped = max(*sizes, self.far) > self.limit

    def _iterate(
        self, rate: Any, outputs: Floats, noise: Floats
    ) -> tuple[Floats, Floats, Any, float, bool]:
        """Find the inputs of all stages, and their remainders, (m, s).

        Then follow the parts for the end of the step, and how the iterations ended: their
        contraction, and whether they converged. Rates and outputs (m, 1) of the amplifiers are
        those at the start of the step, `noise` is rounding, V, (W,).
        """
        m, slopes = len(self.slopes), self.slopes[:, None]
        start = self.now[:m, None]
        # At the start of the step there are no remainders: the first iteration gives `free`.
        free, parts = self.board.free(rate)
        inputs, remainder = free, np.zeros_like(free)
        volts = self.reported.volts(start)[:m, None] / self.tolerance

        def size_of(change: Floats) -> float:
            return float((np.abs(change) * volts).max(initial=0.0))

        floor, before = size_of(noise[:m, None]), size_of(free)
        if before < 1e-4 * SHARE:
            return inputs, remainder, parts, 0.0, True
        for k in range(1, ITERATIONS):
            beyond = self.devices.outputs(start + inputs) - outputs
            beyond = beyond - slopes * inputs
            if not np.isfinite(beyond).all():
                break
            remainder = beyond
            following = free + self.board.response(remainder, parts)
            size = size_of(following - inputs)
            if not math.isfinite(size):
                break
            contraction, inputs = size / before, following
            # No forecast of what is left: beyond a knee of an amplifier convergence is uneven.
            if contraction < 1.0 and size < SHARE:
                return inputs, remainder, parts, contraction, True
            if contraction >= 1.0 or k == ITERATIONS - 1:
                found = size <= floor + SCATTER * size_of(inputs)
                return inputs, remainder, parts, 0.0, found
            before = size
        return inputs, remainder, parts, 0.0, False
