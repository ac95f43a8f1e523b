"""The evidence that an ngspice run must show before its result is accepted.

An exit status of 0 is not enough. A result is accepted when

1. the process ended by itself, with exit status 0 and in time;
2. its error stream has no line that matches `FAILURES` (a singular matrix, or a failed search for
   the operating point, from which ngspice recovered is not fatal: the line becomes a flag);
3. the raw file holds exactly one plot, that of the requested analysis;
4. the plot has points, and as many bytes as points x vectors x 8;
5. the plot has exactly the requested vectors;
6. the time increases strictly, from within the first step to the stop time within 1e-9;
7. every value is finite and below a physical bound (ngspice clamps an overflow to 1e99, and
   computes 1/0 as 1e32 and the square root of a negative number as that of its magnitude);
8. the deck passed `verification.engines.ngspice.screening` before it was sent.
"""

from __future__ import annotations

import re
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from netlist_gen.analysis import OperatingPoint, Transient
from spice_models.array_types import Floats
from spice_models.errors import (
    BadEvidence,
    DidNotLoad,
    Killed,
    OutOfDisk,
    SimulationError,
    SingularCircuit,
    StepTooSmall,
    TimedOut,
)
from verification.engines.ngspice.raw_file import Plot, read_raw
from verification.engines.ngspice.screening import Deck
from verification.waveforms import Cost, Waveforms

STOP_TOLERANCE = 1e-9
_PLOT_NAMES = {Transient: "Transient Analysis", OperatingPoint: "Operating Point"}


@dataclass(frozen=True, slots=True)
class Ending:
    """How a process ended: exit status (negative: a signal), wall time in s, and error stream."""

    status: int
    timed_out: bool
    timeout: float
    seconds: float
    errors: str
    folder: Path

    @property
    def raw(self) -> Path:
        """The result file."""
        return self.folder / "out.raw"


FAILURES: tuple[tuple[str, type[SimulationError], str], ...] = (
    # The first pattern that matches names the failure, so causes precede their consequences.
    (
        r"write error|no space left|adjusting rawfile",
        OutOfDisk,
        "the result could not be written. Free space where runs are kept (TMPDIR)",
    ),
    (
        r"(?s)singular matrix.*(operating point could not|initial timepoint)",
        SingularCircuit,
        "the circuit's matrix is singular: the circuit has a loop of voltage sources, or a node"
        " whose voltage no element determines",
    ),
    (
        r"time ?step too small",
        StepTooSmall,
        "the time step fell below the simulator's limit: the circuit has no solution there, or"
        " its tolerances are below rounding noise",
    ),
    (
        r"error on line|unable to find|unknown subckt|could not find|not parsed|no circuits? loaded"
        r"|circuits loaded|ignored|unusual leading|can't find|netlist line|set to 1|empty netlist",
        DidNotLoad,
        "ngspice did not read the deck as it is written",
    ),
    (r"error|fatal|aborted|interrupted|to low", BadEvidence, "ngspice reported an error"),
)
_DOUBT = re.compile(r"singular matrix|gmin stepping|source stepping|transient op", re.IGNORECASE)
# The option `noopiter` asks for these two.
_EXPECTED = ("Note: Starting dynamic gmin stepping", "Note: Dynamic gmin stepping completed")


def accepted_waveforms(deck: Deck, ending: Ending, *, engine: str, bound: float) -> Waveforms:
    """Return the waveforms of a run that shows all its evidence.

    `engine` is for `Waveforms.engine`; `bound` is the largest possible node voltage of a working
    board, V.

    Raises
    ------
    SimulationError
        One of its kinds, for the first piece of evidence that is missing, with the important
        lines of the log and the run folder.
    """
    try:
        _check_end(ending)
        _check_log(ending)
        plot = read_raw(ending.raw)
        _check_plot(deck, plot)
        waveforms = _waveforms(deck, plot, ending, engine)
        _check_time(deck, waveforms.time)
        _check_values(waveforms, bound)
    except SimulationError as error:
        log = important_lines(ending.errors)
        documented = type(error)(str(error), log=log, folder=ending.folder)
        documented.partial = _partial_waveforms(deck, ending, engine)
        raise documented from None
    return waveforms


def important_lines(errors: str, limit: int = 12) -> str:
    """Return the lines of an error stream, notes last of all, each once and at most `limit`."""
    lines = list(dict.fromkeys(line.rstrip() for line in errors.splitlines() if line.strip()))
    important = [line for line in lines if not line.lower().startswith("note:")] or lines
    if len(important) > limit:
        half = limit // 2
        omitted = f"... {len(important) - limit} lines"
        important = [*important[:half], omitted, *important[-half:]]
    return "\n".join(important)


def _check_end(ending: Ending) -> None:
    """Check point 1 for time and signals; the log explains other exit statuses."""
    if ending.timed_out:
        raise TimedOut(
            f"ngspice did not finish within {ending.timeout:g} s. Allow more time, a shorter record"
            " or a larger step"
        )
    if ending.status == -signal.SIGXFSZ:
        raise OutOfDisk("ngspice reached the limit on the size of a file (ulimit -f)")
    if ending.status < 0:
        name = signal.Signals(-ending.status).name
        hint = " (is memory short?)" if ending.status == -signal.SIGKILL else ""
        raise Killed(f"signal {name} ended ngspice after {ending.seconds:.3g} s{hint}")


def _partial_waveforms(deck: Deck, ending: Ending, engine: str) -> Waveforms | None:
    """Return the points that an interrupted run wrote; None without any."""
    try:
        plot = read_raw(ending.raw, partial=True)
        _check_plot(deck, plot)
    except SimulationError:
        return None
    return _waveforms(deck, plot, ending, engine) if len(plot.data) else None


def _check_log(ending: Ending) -> None:
    """Check point 2, and the rest of point 1."""
    for pattern, failure, meaning in FAILURES:
        if re.search(pattern, ending.errors, re.IGNORECASE):
            raise failure(meaning)
    if ending.status != 0:
        raise BadEvidence(f"ngspice ended with exit status {ending.status} and gave no reason")


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


def _waveforms(deck: Deck, plot: Plot, ending: Ending, engine: str) -> Waveforms:
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
        flags=_flags(ending.errors),
    )


def _flags(errors: str) -> tuple[str, ...]:
    """Return the log's warnings that are not fatal, each once."""
    doubts = (line.strip() for line in errors.splitlines() if _DOUBT.search(line))
    return tuple(dict.fromkeys(line for line in doubts if not line.startswith(_EXPECTED)))
