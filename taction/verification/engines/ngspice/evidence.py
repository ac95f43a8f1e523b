"""The evidence that an ngspice run must show before its result is accepted.

An exit status of 0 is not enough. A result is accepted when

1. the process ended by itself, with exit status 0 and in time;
2. its error stream has no line that matches `FAILURES` (a singular matrix, or a failed
   search for the operating point, from which ngspice recovered is a flag);
3. the raw file holds exactly one plot, that of the requested analysis;
4. the plot has points, and as many bytes as points x vectors x 8;
5. the plot has exactly the requested vectors;
6. the time increases strictly, from within the first step to the stop time within 1e-9;
7. every value is finite and below a physical bound (ngspice clamps an overflow to 1e99, and
   computes 1/0 as 1e32 and the square root of a negative number as that of its magnitude).

A noise analysis has a spectrum for each card in the place of 3 to 7, at the requested frequencies,
all finite and zero or more. A node without any noise is refused: ngspice adds a node of an unknown
name to the circuit. ngspice's own integral does not count: on the flanks of a resonance it takes
the density for ``a f^k`` with k in the hundreds, and a underflows.
"""

from __future__ import annotations

import contextlib
import math
import re
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from taction.netlist_gen.analysis import (
    NoiseAnalysis,
    NoiseBand,
    OperatingPoint,
    SimulatedDeck,
    Transient,
)
from taction.system.array_types import Cost, Floats, Waveforms
from taction.system.errors import (
    BadEvidence,
    DidNotLoad,
    Killed,
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
    SingularCircuit,
    StepTooSmall,
    TimedOut,
)
from taction.system.raw_file import Plot, read_plots, read_raw

LONGEST_LINE = 300  # characters of a line of the error stream in a message
RAW = "out.raw"  # the result
REMEDY = (
    "Install it with `apt-get install ngspice` (Debian 12: `-t bookworm-backports` gives 46, which"
    " has the fast KLU solver), or name the executable in TACTION_NGSPICE"
)


@dataclass(frozen=True, slots=True)
class Ending:
    """How a process ended: exit status (negative: a signal), wall time in s, and error stream."""

    status: int
    timed_out: bool
    timeout: float
    seconds: float
    errors: str
    folder: Path


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
    (r"error|fatal|aborted|interrupted|to low|too small", BadEvidence, "ngspice reported an error"),
)
_SHELL = 128  # a shell adds this to the number of the signal that ended its program
_NOT_STARTED = (126, 127)  # of a shell, or of the program that guards ngspice
_DOUBT = re.compile(r"singular matrix|gmin stepping|source stepping|transient op", re.IGNORECASE)
# The option `noopiter` asks for these two.
_EXPECTED = ("Note: Starting dynamic gmin stepping", "Note: Dynamic gmin stepping completed")


def check_end(ending: Ending) -> None:
    """Check point 1 for time and signals; the log explains other exit statuses."""
    status = ending.status
    if ending.timed_out:
        raise TimedOut(
            f"ngspice did not finish within {ending.timeout:g} s. Allow more time, a shorter record"
            " or a larger step"
        )
    if status == -signal.SIGXFSZ:
        raise OutOfDisk("ngspice reached the limit on the size of a file (ulimit -f)")
    number = -status if status < 0 else status - _SHELL
    if 0 < number < signal.NSIG:
        hint = " (is memory short?)" if number == signal.SIGKILL else ""
        known = {each.value: each.name for each in signal.Signals}
        name = known.get(number, str(number))
        raise Killed(f"signal {name} ended ngspice after {ending.seconds:.3g} s{hint}")
    if status in _NOT_STARTED:
        raise SimulatorNotFound(f"ngspice did not start (exit status {status}). {REMEDY}")


def important_lines(errors: str, limit: int = 12) -> str:
    """Return the lines of an error stream, each once, at most `limit`; notes without others."""
    shortened = (line.rstrip()[:LONGEST_LINE] for line in errors.splitlines() if line.strip())
    lines = list(dict.fromkeys(shortened))
    important = [line for line in lines if not line.lower().startswith("note:")] or lines
    if (more := len(important) - limit) > 0:
        important[limit // 2 : -limit // 2] = [f"... {more} lines"]
    return "\n".join(important)


def doubts(errors: str) -> tuple[str, ...]:
    """Return the log's warnings that are not fatal, each once."""
    doubts = (line.strip() for line in errors.splitlines() if _DOUBT.search(line))
    return tuple(dict.fromkeys(line for line in doubts if not line.startswith(_EXPECTED)))


STOP_TOLERANCE = 1e-9
_PLOT_NAMES = {Transient: "Transient Analysis", OperatingPoint: "Operating Point"}


def accepted_waveforms(
    deck: SimulatedDeck, ending: Ending, *, engine: str, bound: float, solver: str = ""
) -> Waveforms:
    """Return the waveforms of a run that shows all its evidence.

    `engine` and `solver` are for `Waveforms`; `bound` is the largest possible node voltage of a
    working board, V.

    SimulationError: one of its kinds, for the first piece of evidence that is missing, with the
      important lines of the log, the run folder, and the points that were written.
    """

    def waveforms(partial: bool) -> Waveforms:
        return _record(deck, read_raw(ending.folder / RAW, partial=partial), ending, engine, solver)

    try:
        with _explained(ending):
            found = waveforms(partial=False)
            _check_time(deck, found.time)
            _check_values(found, bound)
            return found
    except SimulationError as error:
        with contextlib.suppress(SimulationError):
            written = waveforms(partial=True)
            error.partial = written if len(written.time) else None
        raise


@contextlib.contextmanager
def _explained(ending: Ending) -> Iterator[None]:
    """Check points 1 and 2 before the block; give its errors the log and the folder."""
    try:
        check_end(ending)
        for pattern, failure, meaning in FAILURES:
            if re.search(pattern, ending.errors, re.IGNORECASE):
                raise failure(meaning)
        if ending.status != 0:
            status = f"exit status {ending.status}"
            raise BadEvidence(f"ngspice ended with {status} and gave no reason")
        yield
    except SimulationError as error:
        error.log, error.folder = important_lines(ending.errors), ending.folder
        raise


def _check_plot(plot: Plot, name: str, vectors: Sequence[str]) -> None:
    """Check points 3 and 5; `read_raw` has checked for one plot and point 4."""
    if plot.name != name:
        raise BadEvidence(f"the plot is {plot.name!r}; {name!r} was asked for")
    missing, extra = sorted({*vectors} - {*plot.vectors}), sorted({*plot.vectors} - {*vectors})
    if missing or extra or len(plot.vectors) != len(vectors):
        raise BadEvidence(
            f"vectors missing: {', '.join(missing) or 'none'}; not asked for:"
            f" {', '.join(extra) or 'none'}. Is every saved node in the circuit?"
        )


def _check_time(deck: SimulatedDeck, time: Floats) -> None:
    """Check point 6."""
    analysis, ends = deck.analysis, (float(time[0]), float(time[-1]))
    if not isinstance(analysis, Transient):
        if len(time) != 1:
            raise BadEvidence(f"an operating point has one point, not {len(time)}")
    elif not bool(np.all(time[1:] > time[:-1])):
        raise BadEvidence("time does not increase strictly")
    # With `uic` the first point that ngspice writes is its first step, not t = 0.
    elif not 0.0 <= ends[0] <= analysis.max_step:
        raise BadEvidence(f"the record begins at {ends[0]!r} s, not at 0")
    elif abs(ends[1] - analysis.stop) > STOP_TOLERANCE * analysis.stop:
        raise BadEvidence(f"the record ends at {ends[1]!r} s; {analysis.stop!r} s was asked for")


def _check_values(waveforms: Waveforms, bound: float) -> None:
    """Check point 7."""
    # The minimum and maximum are NaN if any value is; this avoids an array of the result's size.
    if waveforms.values.max() <= bound and waveforms.values.min() >= -bound:
        return
    peak = np.maximum(waveforms.values.max(axis=0), -waveforms.values.min(axis=0))
    wrong = np.flatnonzero(~(peak <= bound))
    listed = ", ".join(f"v({waveforms.nodes[i]}) {float(peak[i])!r} V" for i in wrong[:5])
    raise BadEvidence(f"beyond {bound:g} V, or not a number, at {wrong.size} nodes: {listed}")


def _record(deck: SimulatedDeck, plot: Plot, ending: Ending, engine: str, solver: str) -> Waveforms:
    """Check a plot, and copy its columns, in the order of `saved`, into contiguous memory."""
    is_transient = isinstance(deck.analysis, Transient)
    voltages = [f"v({node.lower()})" for node in deck.saved]
    _check_plot(plot, _PLOT_NAMES[type(deck.analysis)], ["time"] * is_transient + voltages)
    if is_transient and plot.vectors[0] != "time":
        raise BadEvidence(f"the first vector is {plot.vectors[0]!r}, not time")
    rows = np.array(plot.data.T, order="C")
    values = rows[[plot.vectors.index(name) for name in voltages]]
    time = rows[0] if is_transient else np.zeros(len(plot.data))
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


SPECTRUM = ("Noise Spectral Density Curves", ("frequency", "onoise_spectrum"))
INTEGRAL = ("Integrated Noise", ("v(onoise_total)",))
FREQUENCY_TOLERANCE = 1e-6


def integrated_noise(deck: SimulatedDeck, ending: Ending) -> float:
    """Return the noise of the saved node over all bands, rms, V.

    SimulationError: one of its kinds; `BadEvidence` where a plot is missing, is another one than
      asked for, or has other frequencies.
    """
    with _explained(ending):
        bands = cast(NoiseAnalysis, deck.analysis).bands
        plots = read_plots(ending.folder / RAW)
        if len(plots) != 2 * len(bands):
            raise BadEvidence(f"{len(plots)} plots; {2 * len(bands)} were asked for")
        for k, plot in enumerate(plots):
            _check_plot(plot, *(SPECTRUM, INTEGRAL)[k % 2])
        # ngspice runs the last card first.
        spectra = sorted(plots[0::2], key=lambda plot: float(plot.data[0, 0]))
        variance = sum(map(_variance, spectra, bands))
        if not variance:
            raise BadEvidence(f"no noise at node {deck.saved[0]}; is the node in the circuit?")
        return math.sqrt(variance)


def _variance(spectrum: Plot, band: NoiseBand) -> float:
    """Return the integral of a spectrum by Simpson's rule over the logarithm of f, V²."""
    from scipy.integrate import simpson

    found, densities = np.array(spectrum.data.T)
    wanted = band.start * 10.0 ** (np.arange(band.steps + 1) / band.density)
    if len(found) != len(wanted) or not np.allclose(found, wanted, FREQUENCY_TOLERANCE, 0.0):
        asked = f"{len(wanted)} from {band.start:g} to {band.stop:g} Hz were asked for"
        raise BadEvidence(f"{len(found)} frequencies; {asked}")
    if not (np.isfinite(densities).all() and densities.min() >= 0.0):
        raise BadEvidence("a noise density is negative or not finite")
    return float(simpson(found * densities**2, x=np.log(found)))
