"""Transients of large linear boards by a Krylov space.

The space (see `krylov_space`) grows until three successive sizes agree on the outputs over the
whole record, and the residual is small. Where no space satisfies that, `simulate` takes implicit
steps instead (see `structured_radau`).
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
STEPPED = "implicit steps"  # start of the flag of a board without a sufficient space
FIRST, BLOCK, LARGEST = 16, 8, 128  # dimensions: at first, added at a time, at most
MARGIN = 0.1  # of the tolerance: bound of the error estimate
SLOWEST = 0.9  # largest ratio of successive changes for the extrapolation
ROUNDING = 1e-8  # of a structured solve, in step amplitudes: least error estimate
MATTERS = 1e-2  # share of a pole in any output, in step amplitudes, above which it enters the shift
HUGE = 1e9  # times the fastest pole: a shift at which only charges matter
INVISIBLE = 1e-12  # least share of an unstable mode, in step amplitudes
OCTAVES, PER_OCTAVE, SCATTERED = 30, 4, 128  # instants at which spaces are compared


@dataclass(frozen=True, slots=True, eq=False)
class ReducedTransient:
    """Node voltages of a large board as functions of time.

    `final` (K,), V, is the equilibrium; `ritz` are the deviations from the equilibrium; `error`
    estimates the largest error of any node over the record, V; `amplitude` is the largest deviation
    at t = 0, V, the step amplitude; `dimension` is that of the space.
    """

    nodes: tuple[str, ...]
    final: Floats
    ritz: Ritz
    error: float
    amplitude: float
    dimension: int

    def at(self, times: Floats) -> Floats:
        """Return voltages at `times` (P,), s; shape (P, K)."""
        return self.ritz.at(times) + self.final

    def uniform(self, step: float, count: int) -> Floats:
        """Return voltages at ``step * (0 .. count - 1)``; shape (count, K)."""
        return self.ritz.uniform(step, count) + self.final


def reduced(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    tolerance: float = TOLERANCE,
) -> ReducedTransient:
    """Reduce a stable linear board to the few states that its transient needs.

    Parameters
    ----------
    circuit, analysis, nodes
        See `exact.simulate`; the result is valid up to `analysis.stop`.
    tolerance : float
        Of the outputs over the whole record, in step amplitudes.

    Raises
    ------
    EngineError
        The board is not linear, has no equilibrium, seems unstable, or no space of at most
        `LARGEST` dimensions suffices.

    Notes
    -----
    Costs three structured factorisations, m solves, and 4 m² products of a number with a vector of
    all unknowns; m is usually 30 to 60.
    """
    board = LinearBoard.of(circuit)
    if board.circuit.amplifiers:
        raise EngineError("Krylov spaces are for linear boards")
    if MARGIN * tolerance < ROUNDING:
        message = f"a tolerance of {tolerance!r} is too close to rounding for a Krylov space"
        raise EngineError(message)
    shift, fastest = _shift(board, analysis, tolerance)
    structure, reported, rest = board.structure, board.reported(nodes), board.equilibrium.values
    watch = np.array([board.descriptor.place(name) for name in reported], dtype=np.int64)
    charge = structure.mass @ (initial_unknowns(board, analysis.initial, analysis.voltages) - rest)
    if not charge.any():
        raise EngineError("the charges are at rest from the start")
    start = structure.settled_voltages(charge, HUGE * fastest)[watch]
    space = Space(structure, shift, charge, watch, LARGEST)
    ritz, error = _converged(space, start, analysis.stop, tolerance)
    amplitude = float(np.abs(start).max(initial=0.0))
    return ReducedTransient(reported, rest[watch], ritz, error, amplitude, space.m)


def _shift(board: LinearBoard, analysis: Transient, tolerance: float) -> tuple[float, float]:
    """Return the magnitude of the coarse board's fastest pole in the outputs, and of all, 1/s.

    Raises
    ------
    EngineError
        The outputs do not move; or the coarse board is unstable: rounding excites such a mode, but
        the Krylov space of the strain step does not contain it.
    """
    coarse = board.coarse
    space, modes = coarse.state_space, coarse.state_space.modes
    target = space.state_of(coarse.equilibrium.values)
    deviation = space.state_of(initial_unknowns(coarse, analysis.initial)) - target
    C, _ = space.rows([node for node in coarse.reported(None) if node in space.nodes])
    lead, sizes = float(modes.poles.real.max(initial=-math.inf)), np.abs(modes.poles)
    if lead * analysis.stop > math.log(MARGIN * tolerance / INVISIBLE):
        raise EngineError("the coarse board is unstable")
    share = np.abs(modes.amplitudes(C, deviation))
    amplitude = float(np.abs(C @ deviation).max(initial=0.0))
    shown = share.max(axis=0, initial=0.0) > MATTERS * amplitude
    if not (amplitude > 0.0 and shown.any()):
        raise EngineError("the outputs of the coarse board do not move")
    return float(sizes[shown].max()), float(sizes.max())


def _converged(space: Space, start: Floats, stop: float, tolerance: float) -> tuple[Ritz, float]:
    """Grow a space until its error is small enough; return the error, too, V.

    The error is the largest of three: the last change, extrapolated as a geometric series; the
    residual; and the error at t = 0, where stiff modes converge last, and so slowly that two spaces
    may agree and both be wrong.
    """
    instants, amplitude = _instants(stop), float(np.abs(start).max(initial=0.0))
    last: Floats | None = None
    change, reason = amplitude, ""
    more = space.grow(FIRST)
    while more:
        ritz = space.ritz()
        if ritz.stable(stop):
            reason = "it does not converge"
            values = ritz.at(instants)
            if last is not None:
                previous, change = change, float(np.abs(values - last)[:, :-1].max(initial=0.0))
                tail = 1.0 - min(change / max(previous, 1e-300), SLOWEST)
                at_start = np.abs(values[0, :-1] - start).max(initial=0.0)
                error = max(change / tail, float(at_start), float(np.abs(values[:, -1]).max()))
                if error <= MARGIN * tolerance * amplitude:
                    outputs = Ritz(ritz.poles, ritz.share[:, :-1])
                    return outputs, error + ROUNDING * amplitude
            last = values
        else:  # a pole of the board, or only of the projection: a larger space decides
            reason = "it has a pole right of the imaginary axis"
        more = space.m + BLOCK <= LARGEST and space.grow(BLOCK)
    message = f"a Krylov space of {space.m} dimensions does not suffice: {reason}"
    raise EngineError(message)


def _instants(stop: float) -> Floats:
    """Return instants of a record, s: on all time scales from t = 0, and evenly scattered."""
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
    """Simulate a large linear board from a Krylov space, or by steps with a flag for the reason.

    Parameters and errors are those of `structured_radau.simulate`.
    """
    began, board = clock.perf_counter(), LinearBoard.of(circuit)
    stop = analysis.stop if times is None else float(times[-1])
    try:
        solution = reduced(board, replace(analysis, stop=stop), nodes=nodes, tolerance=tolerance)
    except (EngineError, np.linalg.LinAlgError) as refusal:
        stepped = structured_radau.simulate(
            board, analysis, nodes=nodes, times=times, tolerance=tolerance
        )
        return replace(stepped, flags=(*stepped.flags, f"{STEPPED}: {refusal}"))
    if times is None:
        instants = record_times(analysis, stop)
        values = solution.uniform(float(instants[1]), len(instants))
    else:
        instants, values = times, solution.at(times)
    cost = Cost(clock.perf_counter() - began, len(instants), 3)
    return Waveforms(instants, solution.nodes, values, "statespace", cost, (), solution.error)
