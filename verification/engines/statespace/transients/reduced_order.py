"""Transients of large linear boards from one Krylov space, where it can be trusted.

The space (see `krylov_space`) grows until three of its sizes, one in the other, say that the
outputs have converged over the whole record, and the residual agrees. Whatever does not come that
far is refused, and `simulate` takes implicit steps in its place (see `structured_radau`).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.linearised.initial_state import initial_unknowns
from verification.engines.statespace.transients import structured_radau
from verification.engines.statespace.transients.amplified import record_times
from verification.engines.statespace.transients.krylov_space import Ritz, Space
from verification.waveforms import Cost, Waveforms

TOLERANCE = structured_radau.TOLERANCE  # of the outputs at all times, in step amplitudes
STEPPED = "implicit steps"  # begins the flag of a board that no space was trusted with
FIRST, BLOCK, LARGEST = 16, 8, 128  # dimensions at the first look, between looks, at most
MARGIN = 0.1  # of the tolerance: what the estimate must stay below
SLOWEST = 0.9  # of the last change: how slow a convergence is extrapolated, at most
ROUNDING = 1e-8  # of the step amplitude, in structured solves: no error is claimed to be less
MATTERS = 1e-2  # share of a pole in any output, in step amplitudes, for the shift to heed it
HUGE = 1e9  # times the fastest pole: a shift at which only charges are left
INVISIBLE = 1e-12  # share, in step amplitudes, that an unstable mode has at least
OCTAVES, PER_OCTAVE, SCATTERED = 30, 4, 128  # instants at which spaces are compared


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """Node voltages of a large board as functions of time.

    Attributes
    ----------
    nodes : tuple of str
        K of them.
    final : ndarray (K,)
        At the equilibrium, V.
    ritz : Ritz
        Of the K deviations from it.
    error : float
        Estimate of the largest error of any node over the record, V.
    amplitude : float
        Largest deviation at t = 0, V: the step amplitude.
    dimension : int
        Of the space.
    """

    nodes: tuple[str, ...]
    final: Floats
    ritz: Ritz
    error: float
    amplitude: float
    dimension: int

    def at(self, times: Floats) -> Floats:
        """Voltages at `times` (P,), s; shape (P, K)."""
        return self.ritz.at(times) + self.final

    def uniform(self, step: float, count: int) -> Floats:
        """Voltages at ``step * (0 .. count - 1)``; shape (count, K)."""
        return self.ritz.uniform(step, count) + self.final


def reduced(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    tolerance: float = TOLERANCE,
) -> Reduced:
    """Reduce a stable linear board to the few states that its transient needs.

    Parameters
    ----------
    circuit, analysis, nodes
        As `exact.simulate` has them; nothing is said of instants after `analysis.stop`.
    tolerance : float
        Of the outputs over the whole record, in step amplitudes.

    Raises
    ------
    EngineError
        The board is not linear, has no equilibrium, looks unstable, or no space of at most
        `LARGEST` dimensions was shown to suffice.

    Notes
    -----
    Costs three structured factorisations, m solves, and 4 m² products of a number with a vector of
    all unknowns; m is 30 to 60 as a rule.
    """
    board = LinearBoard.of(circuit)
    if board.circuit.amplifiers:
        raise EngineError("Krylov spaces are for linear boards")
    if MARGIN * tolerance < ROUNDING:
        message = f"a tolerance of {tolerance!r} is too close to rounding for a Krylov space"
        raise EngineError(message)
    shift, fastest = _shift(board, analysis, tolerance)
    structure, wanted, rest = board.structure, board.reported(nodes), board.equilibrium.values
    watch = np.array([board.descriptor.place(name) for name in wanted], dtype=np.int64)
    charge = structure.mass @ (initial_unknowns(board, analysis.initial, analysis.voltages) - rest)
    if not charge.any():
        raise EngineError("nothing moves")
    # Just after the step the charges are still there: c (c M - K)^-1 q for a huge c.
    huge = HUGE * fastest
    start = huge * structure.factor(huge).solve(charge)[watch]
    space = Space(structure, shift, charge, watch, LARGEST)
    ritz, error = _converged(space, start, analysis.stop, tolerance)
    amplitude = float(np.abs(start).max(initial=0.0))
    return Reduced(wanted, rest[watch], ritz, error, amplitude, space.m)


def _shift(board: LinearBoard, analysis: Transient, tolerance: float) -> tuple[float, float]:
    """Magnitudes of the fastest pole that the outputs of a coarse image show, and of all, 1/s.

    Raises
    ------
    EngineError
        The image shows nothing; or an instability that grows out of rounding, which a space that
        the strain spans would not contain.
    """
    coarse = board.coarse
    space, modes = coarse.state_space, coarse.state_space.modes
    target = space.state_of(coarse.equilibrium.values)
    deviation = space.state_of(initial_unknowns(coarse, analysis.initial)) - target
    C, _ = space.rows([node for node in coarse.reported(None) if node in space.nodes])
    lead, sizes = float(modes.poles.real.max(initial=-math.inf)), np.abs(modes.poles)
    if lead * analysis.stop > math.log(MARGIN * tolerance / INVISIBLE):
        raise EngineError("the board's coarse image is unstable")
    share = np.abs(modes.amplitudes(C, deviation))
    amplitude = float(np.abs(C @ deviation).max(initial=0.0))
    shown = share.max(axis=0, initial=0.0) > MATTERS * amplitude
    if not (amplitude > 0.0 and shown.any()):
        raise EngineError("the outputs of the board's coarse image do not move")
    return float(sizes[shown].max()), float(sizes.max())


def _converged(space: Space, start: Floats, stop: float, tolerance: float) -> tuple[Ritz, float]:
    """Grow a space until it is shown to suffice; return its error, too, V.

    The error is the largest of three: the change since the last look, extrapolated as a geometric
    series; the residual; and what is missed at t = 0, where stiff modes converge last, and so
    slowly that two spaces may agree and both be wrong.
    """
    instants, amplitude = _instants(stop), float(np.abs(start).max(initial=0.0))
    last: Floats | None = None
    change, reason = amplitude, ""
    more = space.grow(FIRST)
    while more:
        found = space.ritz()
        if found.stable(stop):
            reason = "it does not converge"
            seen = found.at(instants)
            if last is not None:
                before, change = change, float(np.abs(seen - last)[:, :-1].max(initial=0.0))
                tail = 1.0 - min(change / max(before, 1e-300), SLOWEST)
                missed = np.abs(seen[0, :-1] - start).max(initial=0.0)
                error = max(change / tail, float(missed), float(np.abs(seen[:, -1]).max()))
                if error <= MARGIN * tolerance * amplitude:
                    ritz = Ritz(found.poles, found.share[:, :-1])
                    return ritz, error + ROUNDING * amplitude
            last = seen
        else:  # the board's own pole, or one of the projection alone: the next look may tell
            reason = "it has a pole right of the imaginary axis"
        more = space.m + BLOCK <= LARGEST and space.grow(BLOCK)
    message = f"a Krylov space of {space.m} dimensions does not suffice: {reason}"
    raise EngineError(message)


def _instants(stop: float) -> Floats:
    """Instants over a whole record: at all scales from t = 0 on, and scattered evenly, s."""
    scales = 2.0 ** -(np.arange(OCTAVES * PER_OCTAVE) / PER_OCTAVE)
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    scattered = np.arange(1, SCATTERED + 1) * golden % 1.0
    return stop * np.sort(np.concatenate([[0.0], scales, scattered]))


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float = TOLERANCE,
) -> Waveforms:
    """Simulate a large linear board: from a Krylov space, or by steps, with a flag that says why.

    Parameters
    ----------
    circuit, analysis, nodes, times, tolerance
        As `structured_radau.simulate` has them.

    Raises
    ------
    EngineError
        As `structured_radau.simulate`.
    """
    began, board = clock.perf_counter(), LinearBoard.of(circuit)
    stop = analysis.stop if times is None else float(times[-1])
    try:
        found = reduced(board, replace(analysis, stop=stop), nodes=nodes, tolerance=tolerance)
    except (EngineError, np.linalg.LinAlgError) as refusal:
        stepped = structured_radau.simulate(
            board, analysis, nodes=nodes, times=times, tolerance=tolerance
        )
        return replace(stepped, flags=(*stepped.flags, f"{STEPPED}: {refusal}"))
    if times is None:
        instants = record_times(analysis, stop)
        values = found.uniform(float(instants[1]), len(instants))
    else:
        instants, values = times, found.at(times)
    cost = Cost(clock.perf_counter() - began, len(instants), 3)
    return Waveforms(instants, found.nodes, values, "statespace", cost, (), found.error)
