"""The evidence that an ngspice run must show before its result is accepted.

An exit status of 0 is not enough. A result is accepted when

1. the process ended by itself, with exit status 0 and in time;
2. its error stream has no line that matches `ending.FAILURES` (a singular matrix, or a failed
   search for the operating point, from which ngspice recovered is a flag);
3. the raw file holds exactly one plot, that of the requested analysis;
4. the plot has points, and as many bytes as points x vectors x 8;
5. the plot has exactly the requested vectors;
6. the time increases strictly, from within the first step to the stop time within 1e-9;
7. every value is finite and below a physical bound (ngspice clamps an overflow to 1e99, and
   computes 1/0 as 1e32 and the square root of a negative number as that of its magnitude);
8. the deck passed `taction.verification.engines.ngspice.screening` before it was sent.
"""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.analysis import OperatingPoint, Transient
from taction.system.array_types import Floats
from taction.system.errors import BadEvidence, SimulationError
from taction.verification.engines.ngspice.ending import (
    Ending,
    check_end,
    check_log,
    doubts,
    important_lines,
)
from taction.verification.engines.ngspice.raw_file import Plot, read_raw
from taction.verification.engines.ngspice.screening import Deck
from taction.verification.waveforms import Cost, Waveforms

STOP_TOLERANCE = 1e-9
_PLOT_NAMES = {Transient: "Transient Analysis", OperatingPoint: "Operating Point"}


def accepted_waveforms(
    deck: Deck, ending: Ending, *, engine: str, bound: float, solver: str = ""
) -> Waveforms:
    """Return the waveforms of a run that shows all its evidence.

    `engine` and `solver` are for `Waveforms`; `bound` is the largest possible node voltage of a
    working board, V.

    Raises
    ------
    SimulationError
        One of its kinds, for the first piece of evidence that is missing, with the important
        lines of the log and the run folder.
    """
    try:
        check_ending(ending)
        plot = read_raw(ending.raw)
        _check_plot(deck, plot)
        waveforms = _waveforms(deck, plot, ending, engine, solver)
        _check_time(deck, waveforms.time)
        _check_values(waveforms, bound)
    except SimulationError as error:
        explained = documented(error, ending)
        explained.partial = _partial_waveforms(deck, ending, engine, solver)
        raise explained from None
    return waveforms


def check_ending(ending: Ending) -> None:
    """Check points 1 and 2."""
    check_end(ending)
    check_log(ending)


def documented(error: SimulationError, ending: Ending) -> SimulationError:
    """Return an error with the important lines of the log and the run folder."""
    return type(error)(str(error), log=important_lines(ending.errors), folder=ending.folder)


def _partial_waveforms(deck: Deck, ending: Ending, engine: str, solver: str) -> Waveforms | None:
    """Return the points that an interrupted run wrote; None without any."""
    try:
        plot = read_raw(ending.raw, partial=True)
        _check_plot(deck, plot)
    except SimulationError:
        return None
    return _waveforms(deck, plot, ending, engine, solver) if len(plot.data) else None


def _check_plot(deck: Deck, plot: Plot) -> None:
    """Check points 3 and 5; `read_raw` has checked for one plot and point 4."""
    requested = _PLOT_NAMES[type(deck.analysis)]
    if plot.name != requested:
        raise BadEvidence(f"the plot is {plot.name!r}; {requested!r} was asked for")
    expected = {f"v({node.lower()})" for node in deck.saved}
    if isinstance(deck.analysis, Transient):
        expected.add("time")
        if plot.vectors[0] != "time":
            raise BadEvidence(f"the first vector is {plot.vectors[0]!r}, not time")
    vectors = set(plot.vectors)
    if vectors != expected or len(plot.vectors) != len(expected):
        missing, extra = sorted(expected - vectors), sorted(vectors - expected)
        raise BadEvidence(
            f"vectors missing: {', '.join(missing) or 'none'}; not asked for:"
            f" {', '.join(extra) or 'none'}. Is every saved node in the circuit?"
        )


def _check_time(deck: Deck, time: Floats) -> None:
    """Check point 6."""
    analysis = deck.analysis
    if not isinstance(analysis, Transient):
        if len(time) != 1:
            raise BadEvidence(f"an operating point has one point, not {len(time)}")
        return
    if not bool(np.all(time[1:] > time[:-1])):
        raise BadEvidence("time does not increase strictly")
    # With `uic` the first point that ngspice writes is its first step, not t = 0.
    if not 0.0 <= time[0] <= analysis.max_step:
        raise BadEvidence(f"the record begins at {float(time[0])!r} s, not at 0")
    if abs(time[-1] - analysis.stop) > STOP_TOLERANCE * analysis.stop:
        raise BadEvidence(
            f"the record ends at {float(time[-1])!r} s; {analysis.stop!r} s was asked for"
        )


def _check_values(waveforms: Waveforms, bound: float) -> None:
    """Check point 7."""
    # The minimum and maximum are NaN if any value is; this avoids an array of the result's size.
    if waveforms.values.max() <= bound and waveforms.values.min() >= -bound:
        return
    peak = np.maximum(waveforms.values.max(axis=0), -waveforms.values.min(axis=0))
    wrong = np.flatnonzero(~(peak <= bound))
    listed = ", ".join(f"v({waveforms.nodes[i]}) {float(peak[i])!r} V" for i in wrong[:5])
    raise BadEvidence(f"beyond {bound:g} V, or not a number, at {wrong.size} nodes: {listed}")


def _waveforms(deck: Deck, plot: Plot, ending: Ending, engine: str, solver: str) -> Waveforms:
    """Copy the columns in the order of `Deck.saved`, each into contiguous memory.

    A column of the map is neither aligned nor contiguous: on 10,000 x 7 values, the minimum and
    maximum take 0.5 ms there and 0.01 ms on the copy.
    """
    rows = np.array(plot.data.T, order="C")
    columns = [plot.vectors.index(f"v({node.lower()})") for node in deck.saved]
    first = columns[0]
    in_order = columns == list(range(first, first + len(columns)))
    values = rows[first : first + len(columns)] if in_order else rows[columns]
    time = rows[0] if isinstance(deck.analysis, Transient) else np.zeros(len(plot.data))
    return Waveforms(
        time=time,
        nodes=deck.saved,
        values=values.T,
        engine=engine,
        cost=Cost(seconds=ending.seconds, points=len(plot.data)),
        flags=doubts(ending.errors),
        solver=solver,
        method=getattr(deck.analysis, "method", ""),  # an operating point has none
    )
