"""Time scales of a board: how long its strain step must be simulated, and how finely."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Complexes, Floats
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.linearised.initial_state import initial_unknowns

GROWN = 10.0  # an instability counts as seen once it is this many step amplitudes high
INVISIBLE = 1e-12  # amplitude that rounding and asymmetry lend to a mode nothing excites
RESOLVED = 1e6  # step amplitudes: modes that must cancel to more than that are defective
UNRESOLVED = 1e6  # amplitude given to each of them else: t^k exp(-t) peaks higher than exp(-t)
RINGS = 1.0 / math.sqrt(2.0)  # a mode rings if its damping ratio is below this


@dataclass(frozen=True, slots=True)
class Ringing:
    """One oscillating mode that the strain step excites.

    Attributes
    ----------
    frequency, period : float
        Hz, s.
    decay : float
        Time constant of its envelope, s; negative where it grows.
    amplitude : float
        Largest initial amplitude over the outputs, in step amplitudes.
    """

    frequency: float
    period: float
    decay: float
    amplitude: float


@dataclass(frozen=True, slots=True, eq=False)
class TimeScales:
    """How long to simulate a board, and how finely, from the modes that its step excites.

    Attributes
    ----------
    poles : ndarray (n,)
        1/s, rightmost first.
    amplitudes : ndarray (n,)
        Largest share of each mode in any output, in step amplitudes.
    slowest : float
        Time constant of the slowest decaying mode that matters, s.
    ringing : tuple of Ringing
        Oscillating modes that matter, the fastest first.
    growth_time : float
        When the fastest growing mode stands `GROWN` step amplitudes high, s; infinite if stable.
    stop : float
        Suggested stop time, s.
    max_step : float
        Suggested maximum step, s.
    complete : bool
        Whether `poles` are those of the board itself; False for a large board, where they are
        those of its coarse image (`coarse_board`) and not to be judged by.
    """

    poles: Complexes
    amplitudes: Floats
    slowest: float
    ringing: tuple[Ringing, ...]
    growth_time: float
    stop: float
    max_step: float
    complete: bool = True

    def stop_for(self, error: float) -> float:
        """Time after which all decaying modes together stay below `error` step amplitudes, s.

        An unstable board gets the time to show it (`growth_time`) where that is longer. Not
        bounded: a pole close to the imaginary axis makes it as long as it must be.
        """
        decaying = self.poles.real < 0.0
        weight, rate = self.amplitudes[decaying], self.poles.real[decaying]
        settled = last_crossing(weight, rate, error)
        return max(settled, self.growth_time) if math.isfinite(self.growth_time) else settled

    def max_step_for(self, points: float) -> float:
        """Return the step that puts `points` points on the period of the fastest ringing, s.

        Without ringing, the fastest mode with a tenth of the step amplitude takes its place, with
        ``2 pi / |p|`` for a period.
        """
        if self.ringing:
            return self.ringing[0].period / points
        large = np.abs(self.poles[self.amplitudes >= 0.1 * self.amplitudes.max(initial=0.0)])
        return 2.0 * math.pi / float(large.max()) / points if len(large) else math.inf


def last_crossing(weight: Floats, rate: Floats, level: float) -> float:
    """Solve ``sum weight exp(rate t) = level`` for t >= 0 (weights positive, rates negative).

    The sum's logarithm is convex, so Newton's steps on it from t = 0 come from one side.
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
        # Close to the start the time is small, and its last digits are the level's rounding.
        if abs(step) <= 1e-12 * t or abs(excess) <= 1e-13:
            return t


def time_scales(
    circuit: Circuit | LinearBoard,
    *,
    error: float = 1e-4,
    points: float = 60.0,
    initial: Literal["zero", "rest"] = "zero",
) -> TimeScales:
    """Find the time scales that the strain step shows at the outputs.

    Of a board with behavioural amplifiers the modes are those of its equilibrium with the strain
    applied: an estimate where the step is large.

    Parameters
    ----------
    error : float
        Modes below this many step amplitudes do not matter; `stop` leaves this much.
    points : float
        Points that `max_step` puts on the fastest ringing period.
    initial : str
        As `netlist_gen.analysis.Transient` has it.

    Raises
    ------
    EngineError
        No state-space form, or no equilibrium.
    """
    board = LinearBoard.of(circuit)
    large = board.descriptor.is_large
    board = board.coarse if large else board
    space, modes = board.state_space, board.state_space.modes
    C, _ = space.rows(sorted({*board.reported(None)}.intersection(space.nodes)))
    target = space.state_of(board.equilibrium.values)
    deviation = space.state_of(initial_unknowns(board, initial)) - target
    step = float(np.abs(C @ deviation).max(initial=0.0))
    weight = np.ones(space.n)
    if step > 0.0:
        with np.errstate(invalid="ignore", over="ignore"):
            weight = np.abs(modes.amplitudes(C, deviation)).max(axis=0, initial=0.0) / step
        if not weight.sum() < RESOLVED:
            weight = np.full(space.n, UNRESOLVED)
    return _scales(modes.poles, weight, error, points, complete=not large)


def _scales(
    p: Complexes, weight: Floats, error: float, points: float, *, complete: bool
) -> TimeScales:
    matters = weight >= error
    decay = -1.0 / p.real[matters & (p.real < 0.0)]
    rings = matters & (p.imag > 0.0) & (-p.real < RINGS * np.abs(p))
    growing = p.real > 0.0
    growth = np.log(GROWN / np.maximum(weight[growing], INVISIBLE)) / p.real[growing]
    scales = TimeScales(
        poles=p,
        amplitudes=weight,
        slowest=float(decay.max(initial=0.0)),
        ringing=tuple(sorted(_ringing(p[rings], 2.0 * weight[rings]), key=lambda r: r.period)),
        growth_time=float(np.maximum(growth, 0.0).min(initial=math.inf)),
        stop=0.0,
        max_step=0.0,
        complete=complete,
    )
    return replace(scales, stop=scales.stop_for(error), max_step=scales.max_step_for(points))


def _ringing(poles_: Complexes, amplitudes: Floats) -> Iterable[Ringing]:
    for p, amplitude in zip(poles_.tolist(), amplitudes.tolist(), strict=True):
        frequency = p.imag / (2.0 * math.pi)
        decay = -1.0 / p.real if p.real else math.inf  # on the axis to the last bit
        yield Ringing(frequency, 1.0 / frequency, decay, amplitude)
