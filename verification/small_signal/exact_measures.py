"""Measurements of a linear board on its exact solution: no grid decides, and no record ends.

The definitions are those of `measures`; since the solution is known for all time, a channel is
settled because its modes prove it, not because a record has been long enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Floats
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients.exact import Exact, exact_solution
from verification.measures.measure import ChannelMeasure, Measurements, network_settling_time
from verification.measures.mode_fit import Mode
from verification.measures.settling import ChannelState
from verification.measures.times import Reading, reading
from verification.small_signal.exact_crossings import Continuous
from verification.small_signal.time_scales import last_crossing

SMALL_STEP = 0.05  # of A: a channel with a smaller step has no rise time
KNIFE = 0.005  # of a channel's step: how far a level is moved to see whether a hair decides
GRAZE = 0.05  # of the band: the same for the settling band
FAINT = 1e-5  # of A: a mode below has no share in a channel
UNSEEN = 1e-12  # of A: a growing mode below is excited by nothing but rounding
RISE_TAIL = 1e-3  # of A: when what is left to come is below, nothing rises any more


@dataclass(frozen=True, slots=True, eq=False)
class _Board:
    """One solution under measurement; arrays over channels, and `share` (n, N) in u."""

    solution: Exact
    scan: Continuous
    other: Continuous
    share: Floats
    target: Floats
    start: Floats
    final: Floats
    amplitude: float
    band: float
    levels: tuple[float, float]


def measure_exact(
    circuit: Circuit | LinearBoard,
    target: Floats,
    start: Floats | None = None,
    *,
    initial: Literal["zero", "rest"] = "zero",
    band: float = 0.01,
    rise: tuple[float, float] = (0.1, 0.9),
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
    initial, band, rise
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
    start = solution.start * signs if start is None else start
    amplitude = float(np.abs(target - start).max(initial=0.0))
    share = np.abs(solution.share)
    tolerance = band * amplitude if amplitude > 0.0 else float(share.max(initial=1.0))
    final = solution.final * signs
    scan = Continuous.of(solution, signs, tolerance, _horizon(solution, final - target, tolerance))
    board = _Board(
        solution, scan, scan.mirrored(), share, target, start, final, amplitude, band, rise
    )
    channels = tuple(_channel(board, n) for n in range(len(target)))
    settling, reason = network_settling_time(channels)
    return Measurements(amplitude, band, channels, settling, reason, _modes(board))


def _horizon(solution: Exact, offset: Floats, tolerance: float) -> float:
    """Instant after which no channel can cross a level of interest any more, s."""
    inner = (1.0 - 2.0 * GRAZE) * tolerance - np.abs(offset)
    room = np.maximum(inner, RISE_TAIL * tolerance)
    decaying = solution.poles.real < 0.0
    rate = solution.poles.real[decaying]
    shortest = 1.0 / float(np.abs(solution.poles).max(initial=1.0))
    if solution.form == "modes":
        share = np.abs(solution.share[decaying])
        ends = [last_crossing(share[:, n], rate, float(left)) for n, left in enumerate(room)]
        return 1.05 * max([shortest, *ends])
    # Defective modes have no amplitudes: look for a stretch of three times its past that is calm.
    end = shortest
    limit = 1e4 / float(np.abs(rate).min(initial=np.inf)) if len(rate) else shortest
    while end < limit:
        stretch = np.linspace(end, 4.0 * end, 200)
        if np.all(np.abs(solution.at(stretch) - solution.final) <= room):
            break
        end *= 1.5
    return end


def _channel(board: _Board, n: int) -> ChannelMeasure:
    state, reason = _state(board, n)
    settling = None
    if state is ChannelState.SETTLED and board.amplitude > 0.0:
        settling = _settling(board, n)
    elif state is ChannelState.SETTLED:
        reason = "no channel has a step (target equals start): a band in % of it has no width"
    rise_time, rise_reason = _rise(board, n, state)
    lead = _leading(board, n)
    step = float(board.target[n] - board.start[n])
    side = board.scan if step >= 0.0 else board.other
    beyond = side.highest(n) - math.copysign(1.0, step) * float(board.target[n])
    return ChannelMeasure(
        index=n,
        target=float(board.target[n]),
        final=float(board.final[n]),
        rise_time=rise_time,
        settling_time=settling,
        overshoot=max(beyond, 0.0) / board.amplitude if board.amplitude > 0.0 else 0.0,
        state=state,
        frequency=None if lead is None else lead.imag / (2.0 * math.pi),
        growth_rate=None if lead is None else lead.real,
        reason=reason,
        rise_reason=rise_reason,
    )


def _state(board: _Board, n: int) -> tuple[ChannelState, str]:
    poles = board.solution.poles
    growing = (poles.real >= 0.0) & (board.share[:, n] > UNSEEN * board.amplitude)
    if np.any(growing):
        lead = complex(poles[growing][0])
        if lead.imag != 0.0:
            reason = f"it rings at {abs(lead.imag) / (2 * math.pi):.4g} Hz, growing by \
{lead.real:.4g} /s: it never settles"
            return ChannelState.OSCILLATING, reason
        return ChannelState.DIVERGED, f"it runs away with {lead.real:.4g} /s"
    off = float(board.final[n] - board.target[n])
    if abs(off) > board.band * board.amplitude and board.amplitude > 0.0:
        reason = f"at rest {off!r} off target: the reference and the circuit disagree"
        return ChannelState.NOT_SETTLED, reason
    return ChannelState.SETTLED, ""


def _settling(board: _Board, n: int) -> Reading | None:
    target, tolerance = float(board.target[n]), board.band * board.amplitude

    def last(level: float) -> float | None:
        if abs(float(board.final[n]) - target) > level:
            return None
        found = (
            board.scan.last_above(n, target + level),
            board.other.last_above(n, level - target),
        )
        return max([0.0, *(t for t in found if t is not None)])

    at = last(tolerance)
    if at is None:
        return None
    others = [last(tolerance * (1.0 + side)) for side in (-GRAZE, GRAZE)]
    # A channel that never leaves the band has settled at 0: no crossing, so no doubt of one.
    return reading(at, _doubt(board, n, at) if at > 0.0 else 0.0, others)


def _doubt(board: _Board, n: int, t: float) -> float:
    """How far the solution's own rounding error may move a crossing, s."""
    slope = abs(float(board.scan.values(n, np.array([t]))[1][0]))
    spacing = float(np.spacing(t))
    return max(board.solution.error / slope, spacing) if slope > 0.0 else spacing


def _rise(board: _Board, n: int, state: ChannelState) -> tuple[Reading | None, str]:
    step = float(board.target[n] - board.start[n])
    if abs(step) < SMALL_STEP * board.amplitude or step == 0.0:
        return None, f"its own step {step!r} is under {SMALL_STEP:.0%} of the network's"
    if state not in (ChannelState.SETTLED, ChannelState.NOT_SETTLED):
        return None, f"the channel is {state.value}"
    side, sign = (board.scan, 1.0) if step > 0.0 else (board.other, -1.0)

    def first(level: float) -> float | None:
        return side.first_above(n, sign * (float(board.start[n]) + level * step))

    low, high = board.levels
    begin, end = first(low), first(high)
    if begin is None or end is None:
        return None, "it never reaches the levels of its own step"
    others = [None if t is None else t - begin for t in (first(high - KNIFE), first(high + KNIFE))]
    others += [end - t for t in (first(low - KNIFE), first(low + KNIFE)) if t is not None]
    return reading(end - begin, _doubt(board, n, begin) + _doubt(board, n, end), others), ""


def _leading(board: _Board, n: int) -> complex | None:
    """Pole of the strongest ringing in a channel."""
    poles = board.solution.poles
    rings = (poles.imag > 0.0) & (-poles.real < 0.7 * np.abs(poles))
    rings &= board.share[:, n] > FAINT * board.amplitude
    if not np.any(rings):
        return None
    return complex(poles[rings][np.argmax(board.share[rings, n])])


def _modes(board: _Board) -> tuple[Mode, ...]:
    """Ringing modes as a fit would give them, at t = 0 and without doubt, strongest first."""
    poles, found = board.solution.poles, []
    for pole, row in zip(poles.tolist(), board.share, strict=True):
        peak = 2.0 * float(row.max(initial=0.0))
        if pole.imag > 0.0 and -pole.real < 0.7 * abs(pole) and peak > FAINT * board.amplitude:
            channels = tuple((2.0 * row).tolist())
            frequency = pole.imag / (2.0 * math.pi)
            mode = Mode(frequency, pole.real, peak, 0.0, 0.0, 0.0, channels, 0.0, 0.0, "")
            found.append(mode)
    return tuple(sorted(found, key=lambda mode: -mode.amplitude))
