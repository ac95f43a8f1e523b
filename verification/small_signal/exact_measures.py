"""Measurements of a linear board on its exact solution, without a sampled record.

Definitions and readings are those of `measures`. The solution is known for all time, so the modes,
and not the length of a record, show whether a channel settles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Bools, Floats
from spice_models.definitions import FAINT, SETTLING_BAND
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients.exact import Exact, exact_solution
from verification.measures.measurements import (
    NO_STEP,
    Measurements,
    channel_measure,
    strongest,
    summary,
)
from verification.measures.mode_fit import Mode
from verification.measures.readings import Reading, Step, read
from verification.measures.settling import ChannelState, Settlement
from verification.small_signal.exact_crossings import ExactSignal
from verification.small_signal.time_scales import INVISIBLE, RINGS, last_crossing

ALIVE = 1e-4  # of the settling band: smaller amplitudes are ignored


@dataclass(frozen=True, slots=True, eq=False)
class _Board:
    """A solution to measure; `share` (n, N) of modes in u, `growing` (n, N) where they grow."""

    solution: Exact
    share: Floats
    growing: Bools
    step: Step
    final: Floats
    band: float


def measure_exact(
    circuit: Circuit | LinearBoard,
    target: Floats,
    start: Floats | None = None,
    *,
    initial: Literal["zero", "rest"] = "zero",
    band: float = SETTLING_BAND,
) -> Measurements:
    """Measure the step response of a linear board.

    Parameters
    ----------
    circuit : Circuit or LinearBoard
        Board without behavioural amplifiers.
    target : ndarray (N,)
        Reference steady state of u, V.
    start : ndarray (N,), optional
        u before the step, V; the default is the start of the solution.
    initial, band
        As in `netlist_gen.analysis.Transient` and `measures.measure`.

    Raises
    ------
    EngineError
        As `exact_solution`; or the time scales are too far apart for a grid.

    Notes
    -----
    For a board that never settles the overshoot counts until the decaying modes have decayed.
    The cost is that of `exact_solution`, of the solution at about 25 points per ringing period, and
    of about ten evaluations for every crossing (seven channels: about 0.1 s).
    """
    linear = LinearBoard.of(circuit)
    solution = exact_solution(linear, initial=initial)
    signs = np.array([output.sign for output in linear.circuit.outputs])
    step = Step(solution.start * signs if start is None else start, target)
    amplitude, final, share = step.amplitude, solution.final * signs, np.abs(solution.share)
    tolerance = band * amplitude if amplitude > 0.0 else float(share.max(initial=1.0))
    growing = (solution.poles.real >= 0.0)[:, None] & (share > INVISIBLE * amplitude)
    detail = ALIVE * tolerance
    signal = ExactSignal(solution, signs, target, detail, _horizon(solution, detail))
    readings = read(signal, step, final, tolerance, np.any(growing, axis=0))
    board, modes = _Board(solution, share, growing, step, final, band), _modes(solution, amplitude)
    short = "the channel never reaches the levels of its step"
    channels = []
    for n, reading in enumerate(readings.settling_times):
        settlement, mode = _settlement(board, n, reading), strongest(modes, n, amplitude)
        channels.append(channel_measure(n, step, readings, settlement, mode, short))
    return summary(amplitude, band, modes, channels)


def _horizon(solution: Exact, detail: float) -> float:
    """Return the instant after which every channel is within `detail` of its final value, s."""
    decaying = solution.poles.real < 0.0
    rate = solution.poles.real[decaying]
    shortest = 1.0 / float(np.abs(solution.poles).max(initial=1.0))
    if solution.form == "modes":
        ends = [last_crossing(share, rate, detail) for share in np.abs(solution.share[decaying]).T]
        return max([shortest, *ends])
    # Defective modes have no amplitudes: search a calm interval from t to 4 t instead.
    end = shortest
    limit = 1e4 / float(np.abs(rate).min(initial=np.inf)) if len(rate) else shortest
    while end < limit:
        stretch = np.linspace(end, 4.0 * end, 200)
        if np.all(np.abs(solution.at(stretch) - solution.final) <= detail):
            break
        end *= 1.5
    return end


def _settlement(board: _Board, n: int, reading: Reading | None) -> Settlement:
    """Return from the modes whether channel `n` settles, with its settling time `reading`."""
    amplitude, growing = board.step.amplitude, board.growing[:, n]
    if growing.any():
        lead = complex(board.solution.poles[growing][0])
        if lead.imag != 0.0:
            reason = f"ringing at {abs(lead.imag) / (2 * math.pi):.4g} Hz grows with \
{lead.real:.4g} /s: the channel never settles"
            return Settlement(ChannelState.OSCILLATING, None, reason)
        return Settlement(ChannelState.DIVERGED, None, f"the output grows with {lead.real:.4g} /s")
    if amplitude == 0.0:
        return Settlement(ChannelState.SETTLED, None, NO_STEP)
    off = float(board.final[n] - board.step.target[n])
    if reading is None or abs(off) > board.band * amplitude:
        reason = f"the final value and the reference solution disagree by {off!r} V"
        return Settlement(ChannelState.NOT_SETTLED, None, reason)
    return Settlement(ChannelState.SETTLED, reading, "")


def _modes(solution: Exact, amplitude: float) -> tuple[Mode, ...]:
    """Return the ringing modes, strongest first, with amplitudes at t = 0 and no uncertainty."""
    modes = []
    for pole, row in zip(solution.poles.tolist(), np.abs(solution.share), strict=True):
        peak = 2.0 * float(row.max(initial=0.0))
        if pole.imag > 0.0 and -pole.real < RINGS * abs(pole) and peak > FAINT * amplitude:
            channels = tuple((2.0 * row).tolist())
            frequency = pole.imag / (2.0 * math.pi)
            mode = Mode(frequency, pole.real, peak, 0.0, 0.0, 0.0, channels, 0.0, 0.0, "")
            modes.append(mode)
    return tuple(sorted(modes, key=lambda mode: -mode.amplitude))
