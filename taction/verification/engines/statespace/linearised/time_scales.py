"""Time scales of a board: the record length and time step that its strain step needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.statespace.linearised.linear_board import (
    LinearBoard,
    initial_unknowns,
)

GROWN = 10.0  # step amplitudes: an instability of this height counts as shown
LEAST = 1.0  # time constants: growth shown of a mode that is as high from the start
INVISIBLE = 1e-12  # amplitude of a mode that only rounding and asymmetry excite
SLOWER = 0.5  # times the slowest rate of a coarse board: the board has a mode that it lacks
RINGS = 1.0 / math.sqrt(2.0)  # a mode rings if its damping ratio is below this


@dataclass(frozen=True, slots=True, eq=False)
class TimeScales:
    """Record length and time step of a board, from the modes that its strain step excites."""

    poles: Complexes  # (n,): poles, 1/s, rightmost first
    amplitudes: Floats  # (n,): height of each mode's envelope in any output, in step amplitudes
    rates: Floats  # (n,): rate of each mode's envelope, 1/s
    ringing: tuple[complex, ...]  # upper poles of relevant oscillating modes, 1/s, fastest first
    # Instant at which the fastest growing mode reaches `GROWN`, s; infinite if stable.
    growth_time: float
    stop: float  # suggested stop time, s
    max_step: float  # suggested maximum step, s
    # Step amplitude of the board: the largest distance of an output from the equilibrium at t = 0,
    # V.
    step: float = 0.0
    # Whether `poles` are those of the board; False for a large board, whose `poles` are those of
    # the coarse board (`structured_solve`) and do not show its stability.
    complete: bool = True

    def left(self, time: float) -> float:
        """Return the sum of the decaying modes at an instant, s, in step amplitudes."""
        weight, rate = self._decaying(0.0)
        return float(weight @ np.exp(rate * time))

    def stop_for(self, error: float, *, slowest: float = 0.0) -> float:
        """Return the time after which the sum of decaying modes stays below `error`, s.

        `error` is in step amplitudes. For an unstable board the time is at least `growth_time`.
        The time has no upper bound: a pole close to the imaginary axis makes it very long. With
        `slowest`, 1/s, only modes that decay faster count.
        """
        settled = last_crossing(*self._decaying(slowest), error)
        growing = slowest == 0.0 and math.isfinite(self.growth_time)
        return max(settled, self.growth_time) if growing else settled

    def _decaying(self, slowest: float) -> tuple[Floats, Floats]:
        """Return amplitudes and rates, 1/s, of the modes that decay faster than `slowest`."""
        decaying = self.poles.real < -slowest
        return self.amplitudes[decaying], self.rates[decaying]

    def with_slower(self, pole: complex) -> TimeScales:
        """Return scales of a large board with its rightmost pole, 1/s, if it is slower than theirs.

        The coarse board does not show its amplitude, which is taken as one step amplitude.
        """
        rate, (_, rates) = -pole.real, self._decaying(0.0)
        slowest = -float(rates.max(initial=-math.inf))
        if self.complete or not 0.0 < rate <= SLOWER * slowest:
            return self
        return replace(
            self,
            poles=np.append(self.poles, pole),
            amplitudes=np.append(self.amplitudes, 1.0),
            rates=np.append(self.rates, -rate),
        )

    def max_step_for(self, points: float) -> float:
        """Return the step that puts `points` points on the period of the fastest ringing, s.

        Without ringing, ``2 pi / |p|`` of the fastest mode with at least a tenth of the largest
        amplitude counts as the period.
        """
        if self.ringing:
            return 2.0 * math.pi / self.ringing[0].imag / points
        large = np.abs(self.poles[self.amplitudes >= 0.1 * self.amplitudes.max(initial=0.0)])
        return 2.0 * math.pi / float(large.max()) / points if len(large) else math.inf


def last_crossing(weight: Floats, rate: Floats, level: float) -> float:
    """Solve ``sum weight exp(rate t) = level`` for t >= 0 (weights positive, rates negative).

    The logarithm of the sum is convex, so Newton's method from t = 0 converges from one side.
    """
    if not len(weight) or weight.sum() <= level:
        return 0.0
    if level <= 0.0:
        return math.inf
    t = 0.0
    while True:
        left = weight * np.exp(rate * t)
        total = float(left.sum())
        excess = math.log(total / level)
        step = total * excess / -float(left @ rate)
        t += step
        # Close to t = 0 the rounding of the level limits the relative precision of t.
        if abs(step) <= 1e-12 * t or abs(excess) <= 1e-13:
            return t


def time_scales(
    circuit: Circuit | LinearBoard,
    *,
    error: float = 1e-4,
    points: float = 60.0,
    initial: Literal["zero", "rest"] = "zero",
) -> TimeScales:
    """Compute the time scales of the outputs after the strain step.

    With behavioural amplifiers the modes, those at the equilibrium, are an estimate. Modes below
    the amplitude `error`, step amplitudes, are ignored, and it is left at `stop`; with `max_step`
    the fastest ringing period has so many `points`.

    EngineError: no state-space form, or no equilibrium.
    """
    board = LinearBoard.of(circuit)
    large = board.descriptor.is_large
    board = board.coarse if large else board
    space, modes = board.state_space, board.state_space.modes
    C, _ = space.rows(sorted({*board.reported(None)}.intersection(space.nodes)))
    deviation = initial_unknowns(board, initial) - board.equilibrium.values
    step = float(np.abs(C @ space.state_of(deviation)).max(initial=0.0))
    weight = np.ones(space.n)
    if step > 0.0:
        weight = modes.shares(C, deviation).heights.max(axis=0, initial=0.0) / step
    p, relevant = modes.poles, weight >= error
    rings = relevant & (p.imag > 0.0) & (-p.real < RINGS * np.abs(p))
    growing = p.real > 0.0
    growth = np.log(GROWN / np.maximum(weight[growing], INVISIBLE))
    scales = TimeScales(
        poles=p,
        amplitudes=weight,
        rates=modes.rates,
        ringing=tuple(sorted(p[rings].tolist(), key=lambda each: -each.imag)),
        growth_time=float((np.maximum(growth, LEAST) / p.real[growing]).min(initial=math.inf)),
        stop=0.0,
        max_step=0.0,
        step=step,
        complete=not large,
    )
    return replace(scales, stop=scales.stop_for(error), max_step=scales.max_step_for(points))
