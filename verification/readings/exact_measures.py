"""Measurements of a stable linear board on its exact solution, without a sampled record.

Definitions and readings are those of `measure`. The solution is known for all time, so
nothing depends on the length or the points of a record, and every uncertainty follows from the
bound of the solution's own error.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.reading_definitions import FAINT, SETTLING_BAND
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import RINGS
from taction.verification.engines.statespace.transients.exact import Exact, exact_solution
from taction.verification.readings.exact_signal import ExactSignal
from taction.verification.readings.measurements import (
    NO_STEP,
    Measurements,
    channel_measure,
    strongest,
    summary,
)
from taction.verification.readings.mode_fit import Mode
from taction.verification.readings.readings import Reading, Step, read
from taction.verification.readings.settling import ChannelState, Settlement

DETAIL = 1e-4  # of the settling band: the first grid resolves modes above it
LEVEL = 1e-6  # of the step: error of an excursion, if no limit is nearer


def measure_exact(
    circuit: Circuit | LinearBoard,
    target: Floats,
    start: Floats | None = None,
    *,
    initial: Literal["zero", "rest"] = "zero",
    band: float = SETTLING_BAND,
    target_error: float = 0.0,
    level: float = LEVEL,
) -> Measurements:
    """Measure the step response of a stable linear board.

    Parameters
    ----------
    circuit : Circuit or LinearBoard
        Board without behavioural amplifiers.
    target : ndarray (N,)
        Reference steady state of u, V.
    start : ndarray (N,), optional
        u before the step, V; the default is the start of the solution.
    initial, band
        As in `taction.netlist_gen.analysis.Transient` and `measurements.measure`.
    target_error : float
        Bound of the error of a channel's distance from `target`, V.
    level : float
        Error that an excursion may have, fraction of A; with 0 only that of rounding.

    Raises
    ------
    EngineError
        As `exact_solution`; or the board is not stable.

    Notes
    -----
    The cost is that of `exact_solution`, of the solution at about 25 points per ringing period, at
    most `exact_grid.PER_OCTAVE` for each e-fold of the time, and of about six evaluations for every
    crossing.
    """
    board = LinearBoard.of(circuit)
    solution = exact_solution(board, initial=initial)
    if not np.all(solution.poles.real < 0.0):
        raise EngineError("the board is not stable: its transient has no end to measure")
    signs = np.array([output.sign for output in board.circuit.outputs])
    step = Step(solution.start * signs if start is None else start, target)
    amplitude, final = step.amplitude, solution.final * signs
    tolerance = band * (amplitude or float(np.abs(final - target).max(initial=0.0)) or 1.0)
    detail = DETAIL * tolerance
    signal = ExactSignal(solution, signs, target, target_error, detail, level * amplitude)
    readings = read(signal, step, tolerance, np.zeros(len(target), dtype=np.bool_))
    modes = _modes(solution, amplitude)
    short = "the channel never reaches the levels of its step"
    channels = []
    for n, reading in enumerate(readings["settling_time"]):
        off, bound = float(signal.ends[n]), float(signal.end_bounds[n])
        settlement = _settlement(off, tolerance, bound, reading) if amplitude else STILL
        mode = strongest(modes, n, amplitude)
        end = float(final[n])
        channels.append(channel_measure(n, end, step, readings, settlement, mode, short))
    return summary(amplitude, band, modes, channels)


STILL = Settlement(ChannelState.SETTLED, None, NO_STEP)


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
        peak = float(row.max(initial=0.0))
        if pole.imag > 0.0 and -pole.real < RINGS * abs(pole) and peak > FAINT * amplitude:
            channels = tuple(row.tolist())
            frequency = pole.imag / (2.0 * math.pi)
            mode = Mode(frequency, pole.real, peak, 0.0, 0.0, 0.0, channels, 0.0, 0.0, "")
            modes.append(mode)
    return tuple(sorted(modes, key=lambda mode: -mode.amplitude))
