"""The evidence an ngspice run must show before its result is believed.

An exit status of 0 is the least of it. A result is accepted when

1. the process ended by itself, with exit status 0 and in time;
2. its error stream has no line that `SIGNS` knows (a singular matrix or a failed search for the
   operating point, from which ngspice recovered, is not fatal: it becomes a flag);
3. the raw file holds exactly one plot, the one asked for;
4. it has points, and as many bytes as points x vectors x 8;
5. it has exactly the vectors asked for;
6. its time increases strictly, from within the first step to the stop time within 1e-9;
7. every value is finite and below a physical bound (ngspice clamps an overflow to 1e99, takes
   1/0 for 1e32 and the square root of a negative number for that of its magnitude);
8. the deck was screened before it was sent (`verification.engines.ngspice.screening`).
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
    """What a finished process left behind.

    Attributes
    ----------
    status : int
        Exit status; negative: the signal that ended it.
    timed_out : bool
        Whether it was ended because its time was used up.
    timeout, seconds : float
        Time allowed and wall time used, s.
    errors : str
        Its error stream.
    folder : Path
        The run folder.
    """

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


@dataclass(frozen=True, slots=True)
class Sign:
    """A pattern in the error stream, what it means, and what to do next."""

    pattern: re.Pattern[str]
    failure: type[SimulationError]
    meaning: str


def _sign(pattern: str, failure: type[SimulationError], meaning: str) -> Sign:
    return Sign(re.compile(pattern, re.IGNORECASE), failure, meaning)


SIGNS = (  # the first that is found names the failure, so causes stand before their consequences
    _sign(
        r"write error|no space left|adjusting rawfile",
        OutOfDisk,
        "the result could not be written. Free space where runs are kept (TMPDIR)",
    ),
    _sign(
        r"(?s)singular matrix.*(operating point could not|initial timepoint)",
        SingularCircuit,
        "the circuit's matrix is singular: a loop of voltage sources, or a node that nothing holds",
    ),
    _sign(
        r"time ?step too small",
        StepTooSmall,
        "the time step fell below the simulator's limit: the circuit has no solution there, or"
        " its tolerances are below rounding noise",
    ),
    _sign(
        r"error on line|unable to find|unknown subckt|could not find|not parsed|no circuits? loaded"
        r"|circuits loaded|ignored|unusual leading|can't find|netlist line|set to 1|empty netlist",
        DidNotLoad,
        "the deck was not taken as written",
    ),
    _sign(
        r"error|fatal|aborted|interrupted|to low",
        BadEvidence,
        "the simulator complained",
    ),
)
_DOUBT = re.compile(r"singular matrix|gmin stepping|source stepping|transient op", re.IGNORECASE)
# What `noopiter` asks for is no sign of trouble.
_ORDERED = ("Note: Starting dynamic gmin stepping", "Note: Dynamic gmin stepping completed")


def judge(deck: Deck, ending: Ending, *, engine: str, bound: float) -> Waveforms:
    """Return the waveforms of a run that shows all its evidence.

    Parameters
    ----------
    deck : Deck
        What was run.
    ending : Ending
        What it left behind.
    engine : str
        For `Waveforms.engine`.
    bound : float
        No node voltage of a working board is above this, V.

    Raises
    ------
    SimulationError
        One of its kinds, for the first piece of evidence that is missing, with the log's telling
        lines and the run folder.
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
        partial = partial_waveforms(deck, ending, engine)
        log, folder = telling_lines(ending.errors), ending.folder
        documented = type(error)(str(error), log=log, folder=folder)
        documented.partial = partial
        raise documented from None
    return waveforms


def telling_lines(errors: str, limit: int = 12) -> str:
    """Return the lines of an error stream that say something, each once, at most `limit`."""
    lines = list(dict.fromkeys(line.rstrip() for line in errors.splitlines() if line.strip()))
    telling = [line for line in lines if not line.lower().startswith("note:")] or lines
    if len(telling) > limit:
        half = limit // 2
        telling = [*telling[:half], f"... {len(telling) - limit} lines", *telling[-half:]]
    return "\n".join(telling)


def _check_end(ending: Ending) -> None:
    """Check point 1 as far as time and signals go; the log explains other exit statuses."""
    if ending.timed_out:
        raise TimedOut(
            f"ngspice used up its {ending.timeout:g} s. Allow more time, a shorter record or a"
            " larger step"
        )
    if ending.status == -signal.SIGXFSZ:
        raise OutOfDisk("ngspice reached the limit on the size of a file (ulimit -f)")
    if ending.status < 0:
        name = signal.Signals(-ending.status).name
        hint = " (is memory short?)" if ending.status == -signal.SIGKILL else ""
        raise Killed(f"signal {name} ended ngspice after {ending.seconds:.3g} s{hint}")


def partial_waveforms(deck: Deck, ending: Ending, engine: str) -> Waveforms | None:
    """Return what a run that was cut short had written, or None where that is nothing."""
    try:
        plot = read_raw(ending.raw, partial=True)
        _check_plot(deck, plot)
    except SimulationError:
        return None
    return _waveforms(deck, plot, ending, engine) if len(plot.data) else None


def _check_log(ending: Ending) -> None:
    """Check point 2, and the rest of point 1."""
    for sign in SIGNS:
        if sign.pattern.search(ending.errors):
            raise sign.failure(sign.meaning)
    if ending.status != 0:
        raise BadEvidence(f"ngspice ended with exit status {ending.status} and gave no reason")


def _check_plot(deck: Deck, plot: Plot) -> None:
    """Check points 3 and 5; `read_raw` has seen to one plot and to point 4."""
    wanted = _PLOT_NAMES[type(deck.analysis)]
    if plot.name != wanted:
        raise BadEvidence(f"the plot is {plot.name!r}; {wanted!r} was asked for")
    expected = {f"v({node.lower()})" for node in deck.saved}
    if isinstance(deck.analysis, Transient):
        expected.add("time")
        if plot.vectors[0] != "time":
            raise BadEvidence(f"the first vector is {plot.vectors[0]!r}, not time")
    found = set(plot.vectors)
    if found != expected or len(plot.vectors) != len(expected):
        missing, extra = sorted(expected - found), sorted(found - expected)
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
    # Minimum and maximum pass NaN on, so no array of the result's size is made.
    if waveforms.values.max() <= bound and waveforms.values.min() >= -bound:
        return
    peak = np.maximum(waveforms.values.max(axis=0), -waveforms.values.min(axis=0))
    wrong = np.flatnonzero(~(peak <= bound))
    listed = ", ".join(f"v({waveforms.nodes[i]}) {float(peak[i])!r} V" for i in wrong[:5])
    raise BadEvidence(f"beyond {bound:g} V, or no number, at {wrong.size} nodes: {listed}")


def _waveforms(deck: Deck, plot: Plot, ending: Ending, engine: str) -> Waveforms:
    """Copy the columns in the order of `Deck.saved`, each in one piece.

    Whatever is computed from them later is the quicker for it: a column of the map is neither
    aligned nor contiguous. Minimum and maximum alone take 0.01 ms instead of 0.5 on 10,000 x 7.
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
    """Return lines that cast doubt without being fatal, each once."""
    doubts = (line.strip() for line in errors.splitlines() if _DOUBT.search(line))
    return tuple(dict.fromkeys(line for line in doubts if not line.startswith(_ORDERED)))
