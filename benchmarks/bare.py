"""The cheapest bare ``ngspice -b`` that reaches an error: the baseline of several sections.

A bare run has ngspice's own tolerances, except for ``reltol`` and the longest step, which are taken
from a small ladder. Its outputs are compared with the true solution at every time point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.measuring import processor
from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.system.array_types import Floats
from taction.system.errors import SimulationError
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import exact, simulate
from taction.verification.readings.signals import CUBIC, lagrange
from taction.verification.verdict.step_forecast import StepModel

RELTOL = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
PARTS = (50, 200, 500, 1000, 2000, 5000, 20_000)  # of the record: the longest step
OWN = (".options reltol", ".options method", ".options chgtol", ".tran")  # cards of taction
TOLERANCE, BETWEEN = 1e-9, 1e-9  # of the true solution of a board with amplifiers; interpolation
Truth = Callable[[Floats], Floats]


@dataclass(frozen=True)
class BareRun:
    """A bare run: its deck, its accepted time points, and its error in step amplitudes."""

    deck: Deck
    points: int
    error: float


def solver() -> str:
    """Return the option for the matrix solver of the installed ngspice."""
    return find_simulator().solver_option


def run(deck: Deck, timeout: float) -> Waveforms:
    """Run a deck in an ngspice process of its own."""
    return process.simulate(deck, find_simulator(), timeout=timeout)


def processor_seconds(deck: Deck, timeout: float = 600.0) -> float:
    """Run a deck and return its processor time, with that of the ngspice process, s."""
    return processor(lambda: run(deck, timeout))()


def true_solution(board: LinearBoard, transient: Transient) -> Truth:
    """Return the outputs of a board at any instants of a transient, V.

    Exact for a small linear board; else the state-space engine at a tolerance of `TOLERANCE`, at
    instants so dense that cubic interpolation errs by `BETWEEN` of the step amplitude.
    """
    if not (board.circuit.amplifiers or board.descriptor.is_large):
        return exact.exact_solution(board).at
    times = StepModel.of(board, transient.stop, transient.initial, stable=True).instants(BETWEEN)
    found = simulate.simulate(board, transient, times=times, tolerance=TOLERANCE)
    return lambda at: lagrange(times, found.values, at, CUBIC)


def error_of(record: Waveforms, truth: Truth, stop: float) -> float:
    """Return the largest error of any output at any time point, in step amplitudes."""
    first, last = truth(np.array([0.0, stop]))
    off = np.abs(record.values - truth(np.array(record.time))).max()
    return float(off / np.abs(last - first).max())


def bare_deck(board: LinearBoard, transient: Transient, reltol: float, parts: float) -> Deck:
    """Return the deck of a bare run whose longest step is one of `parts` of the record."""
    deck = write_deck(board.circuit, transient, solver=solver())
    longest = transient.stop / parts
    kept = [line for line in deck.text.splitlines() if not line.startswith(OWN)]
    tran = f".tran {1e-3 * longest!r} {transient.stop!r} 0 {longest!r} uic"
    cards = [f".options reltol={reltol!r}", tran, ".end", ""]
    return replace(deck, text="\n".join([*kept[: kept.index(".end")], *cards]))


def cheapest(
    board: LinearBoard, transient: Transient, truth: Truth, error: float, timeout: float
) -> BareRun | None:
    """Return the run of the ladder with the fewest points whose error is at most `error`.

    A setting that is finer than one with at least as many points as the best run is not tried.
    """
    best: BareRun | None = None
    beaten: list[tuple[float, int]] = []  # settings with more points than the best
    for parts in PARTS:
        for reltol in RELTOL:
            if any(reltol <= r and parts >= p for r, p in beaten):
                continue
            deck = bare_deck(board, transient, reltol, parts)
            try:
                record = run(deck, timeout)
            except SimulationError:
                beaten.append((reltol, parts))
                continue
            found = BareRun(deck, len(record.time), error_of(record, truth, transient.stop))
            if found.points >= (best.points if best else math.inf):
                beaten.append((reltol, parts))
            elif found.error <= error:
                best = found
                beaten.append((reltol, parts))
    return best
