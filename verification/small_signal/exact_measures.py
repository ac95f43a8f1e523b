"""Measurements of a linear board on its exact solution: neither a grid nor a record's end decides.

Definitions and readings are those of `measures`; since the solution is known for all time, a
channel is settled because its modes prove it, not because a record has been long enough.
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

ALIVE = 1e-4  # of the settling band: what stays below is not followed, nor waited for


@dataclass(frozen=True, slots=True, eq=False)
class _Board:
    """A solution under measurement; `share` (n, N) in u, `growing` (n, N): modes that are seen."""

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
        Without behavioural amplifiers.
    target : ndarray (N,)
        Reference steady state of u, V.
    start : ndarray (N,), optional
        u before the step, V; by default the solution's own.
    initial, band
        As `netlist_gen.analysis.Transient` and `measures.measure` have them.

    Raises
    ------
    EngineError
        As `exact_solution`; or time scales too far apart for a grid.

    Notes
    -----
    Of a board that never settles the overshoot is the one until its decaying modes are gone.
    Costs `exact_solution`, the solution at some 25 points a ringing period, and some ten
    evaluations for every time that is read (seven channels: about 0.1 s).
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
    short = "it never reaches the levels of its own step"
    channels = []
    for n, reading in enumerate(readings.settling_times):
        found, mode = _settlement(board, n, reading), strongest(modes, n, amplitude)
        channels.append(channel_measure(n, step, readings, found, mode, short))
    return summary(amplitude, band, modes, channels)


def _horizon(solution: Exact, detail: float) -> float:
    """Instant after which no channel is further than `detail` from where it comes to rest, s."""
    decaying = solution.poles.real < 0.0
    rate = solution.poles.real[decaying]
    shortest = 1.0 / float(np.abs(solution.poles).max(initial=1.0))
    if solution.form == "modes":
        ends = [last_crossing(share, rate, detail) for share in np.abs(solution.share[decaying]).T]
        return max([shortest, *ends])
    # Defective modes have no amplitudes: look for a stretch of three times its past that is calm.
    end = shortest
    limit = 1e4 / float(np.abs(rate).min(initial=np.inf)) if len(rate) else shortest
    while end < limit:
        stretch = np.linspace(end, 4.0 * end, 200)
        if np.all(np.abs(solution.at(stretch) - solution.final) <= detail):
            break
        end *= 1.5
    return end


def _settlement(board: _Board, n: int, reading: Reading | None) -> Settlement:
    """Tell from the modes whether channel `n` settles; `reading` is when it does."""
    amplitude, growing = board.step.amplitude, board.growing[:, n]
    if growing.any():
        lead = complex(board.solution.poles[growing][0])
        if lead.imag != 0.0:
            reason = f"it rings at {abs(lead.imag) / (2 * math.pi):.4g} Hz, growing by \
{lead.real:.4g} /s: it never settles"
            return Settlement(ChannelState.OSCILLATING, None, reason)
        return Settlement(ChannelState.DIVERGED, None, f"it runs away with {lead.real:.4g} /s")
    if amplitude == 0.0:
        return Settlement(ChannelState.SETTLED, None, NO_STEP)
    off = float(board.final[n] - board.step.target[n])
    if reading is None or abs(off) > board.band * amplitude:
        reason = f"at rest {off!r} off target: the reference and the circuit disagree"
        return Settlement(ChannelState.NOT_SETTLED, None, reason)
    return Settlement(ChannelState.SETTLED, reading, "")


def _modes(solution: Exact, amplitude: float) -> tuple[Mode, ...]:
    """Ringing modes as a fit would give them, at t = 0 and without doubt, strongest first."""
    found = []
    for pole, row in zip(solution.poles.tolist(), np.abs(solution.share), strict=True):
        peak = 2.0 * float(row.max(initial=0.0))
        if pole.imag > 0.0 and -pole.real < RINGS * abs(pole) and peak > FAINT * amplitude:
            channels = tuple((2.0 * row).tolist())
            frequency = pole.imag / (2.0 * math.pi)
            mode = Mode(frequency, pole.real, peak, 0.0, 0.0, 0.0, channels, 0.0, 0.0, "")
            found.append(mode)
    return tuple(sorted(found, key=lambda mode: -mode.amplitude))
