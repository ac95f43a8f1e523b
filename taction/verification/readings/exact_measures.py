"""Measurements of a stable linear board on its exact solution, without a sampled record.

Definitions and readings are those of `measure`. The solution is known for all time, so
nothing depends on the length or the points of a record, and every uncertainty follows from the
bound of the solution's own error.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.reading_definitions import FAINT, FOUND, SETTLING_BAND
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import RINGS
from taction.verification.engines.statespace.transients.exact import Exact, exact_solution
from taction.verification.readings.exact_trace import ExactTrace
from taction.verification.readings.measurements import (
    STILL,
    Measurements,
    channel_measure,
    strongest,
    summary,
)
from taction.verification.readings.readings import Reading, Step, read
from taction.verification.readings.ringing import Mode
from taction.verification.readings.settling import ChannelState, Settlement

DETAIL = 1e-6  # of the settling band: the grid resolves modes above it
SHORT = "the channel never reaches the levels of its step"


@dataclass(frozen=True, eq=False)
class ExactResponse:
    """The step response of a linear board, to be measured."""

    board: LinearBoard  # a board without behavioural amplifiers
    target: Floats  # (N,): reference steady state of u, V
    # (N,): u before the step, V; the default is the start of the solution.
    start: Floats | None = None
    # `initial`, `band`: as in `taction.netlist_gen.analysis.Transient` and `measurements.measure`.
    initial: Literal["zero", "rest"] = "zero"
    band: float = SETTLING_BAND
    target_error: float = 0.0  # bound of the error of a channel's distance from `target`, V
    # Error that an excursion may have, fraction of A; with 0 only that of rounding.
    level: float = FOUND

    @functools.cached_property
    def signs(self) -> Floats:
        """Signs of the channels, (N,)."""
        return np.array([output.sign for output in self.board.circuit.outputs])

    @functools.cached_property
    def solution(self) -> Exact:
        """The solution; EngineError as `exact_solution`, and of a board that is not stable."""
        solution = exact_solution(self.board, initial=self.initial)
        if not np.all(solution.poles.real < 0.0):
            raise EngineError("the board is not stable: its transient has no end to measure")
        return solution

    @functools.cached_property
    def step(self) -> Step:
        """The step of the channels."""
        begin = self.solution.start * self.signs if self.start is None else self.start
        return Step(begin, self.target)

    @functools.cached_property
    def tolerance(self) -> float:
        """Half the width of the settling band, V."""
        off = float(np.abs(self.solution.final * self.signs - self.target).max(initial=0.0))
        return self.band * (self.step.amplitude or off or 1.0)

    @functools.cached_property
    def trace(self) -> ExactTrace:
        """The way of the channels to their targets."""
        detail, level = DETAIL * self.tolerance, self.level * self.step.amplitude
        error = self.target_error
        return ExactTrace(self.solution, self.signs, self.target, error, detail, level)

    def measured(self) -> Measurements:
        """Measure the step response; EngineError as `solution`."""
        nothing_lost = np.zeros(len(self.target), dtype=np.bool_)
        readings = read(self.trace, self.step, self.tolerance, nothing_lost)
        amplitude, modes = self.step.amplitude, _modes(self.solution, self.step.amplitude)
        bounds, final = self.solution.rest_error + self.target_error, self.solution.final
        channels = []
        for n, reading in enumerate(readings["settling_time"]):
            off, bound, end = float(self.trace.ends[n]), float(bounds[n]), final[n] * self.signs[n]
            settlement = _settlement(off, self.tolerance, bound, reading) if amplitude else STILL
            mode = strongest(modes, n, amplitude)
            channel = channel_measure(n, float(end), self.step, readings, settlement, mode, SHORT)
            channels.append(channel)
        return summary(amplitude, self.band, modes, channels)


def _settlement(off: float, tolerance: float, bound: float, reading: Reading | None) -> Settlement:
    """Return whether a channel that comes to rest `off` its target, V, settles."""
    if abs(off) > tolerance + bound:
        reason = f"the final value and the reference solution disagree by {off!r} V"
        return Settlement(ChannelState.NOT_SETTLED, None, reason)
    if reading is None or not math.isfinite(reading.uncertainty):
        reason = (
            f"the final value is {off!r} V off, known to ±{bound:.2g} V: at the edge of the band"
        )
        return Settlement(ChannelState.UNDECIDED, None, reason)
    return Settlement(ChannelState.SETTLED, reading, "")


def _modes(solution: Exact, amplitude: float) -> tuple[Mode, ...]:
    """Return the ringing modes, strongest first, with amplitudes at t = 0 and no uncertainty."""
    modes, flow = [], solution.flow
    begin = flow.powers == 0
    for pole, row in zip(flow.poles[begin].tolist(), np.abs(flow.share[begin]), strict=True):
        strong = float(row.max(initial=0.0)) > FAINT * amplitude
        if strong and pole.imag > 0.0 and -pole.real < RINGS * abs(pole):
            modes.append(Mode(pole.imag / (2.0 * math.pi), pole.real, tuple(row.tolist())))
    return tuple(sorted(modes, key=lambda mode: -max(mode.channels)))
