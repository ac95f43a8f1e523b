"""A run of ngspice with commands: what it listed, wrote and said.

The cards come from `taction.netlist_gen.deck.foreign_deck`, which accepts none that runs anything
or names a file; no code model is loaded, standard input is closed, and one limit of time holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from taction.netlist_gen.analysis import Analysis, OperatingPoint
from taction.system.array_types import Complexes
from taction.system.errors import BadEvidence, OutOfDisk, SimulationError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.system.raw_file import read_tables
from taction.system.time_limit import time_left
from taction.system.waveforms import PHYSICAL_BOUND
from taction.verification.engines.ngspice.evidence import Ending, check_end, longest
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import (
    STREAMS,
    Run,
    command_line,
    make_folder,
)

SECONDS = 20.0
MEMORY = 1000 * MEGABYTE  # addresses of ngspice
RESULT = "result.raw"
TEXT = "listed.txt"
_COMPLAINT = re.compile(
    r"^(?!.*(?:Note:|incomplete or empty|netlist line no)).*"
    r"(?:[Ee]rror|annot|ndefined|nknown|ailed|[Tt]oo few|no such|singular).*$",
    re.M,
)
SHOWN = 5  # lines of a complaint
OVER = "error: the time that all runs of ngspice have together is over"


@dataclass(frozen=True, slots=True)
class CommandDeck:
    """Cards with commands, and start-up files."""

    text: str
    files: Mapping[str, str] = field(default_factory=dict)
    saved: tuple[str, ...] = ()
    analysis: Analysis = field(default_factory=OperatingPoint)


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What ngspice wrote with ``write``, plot by plot, what it listed, and what it said."""

    plots: tuple[tuple[tuple[str, ...], Complexes], ...]
    listed: str
    said: str

    @property
    def complaint(self) -> str:
        """The lines that tell what is wrong."""
        lines = dict.fromkeys(line.strip() for line in _COMPLAINT.findall(self.said))
        return "; ".join(list(lines)[:SHOWN])[:400] or "it says nothing"


def run_commands(
    cards: Iterable[str],
    commands: Sequence[str],
    simulator: Simulator,
    *,
    mode: str = "",
    seconds: float = SECONDS,
) -> Answers:
    """Run commands on cards.

    Parameters
    ----------
    cards : iterable of str
        One a line, checked before.
    commands : sequence of str
        They write plots into `RESULT` and listings into `TEXT`.
    mode : str
        Of ngspice's ``ngbehavior``, such as ``"psa"``; empty for its own.
    seconds : float
        Time allowed, s; less where `taction.system.time_limit` leaves less.
    """
    if not (seconds := time_left(seconds)):
        return Answers((), "", OVER)
    lines = ["* deck", *cards, ".control", *commands, "quit", ".endc", ".end", ""]
    start = f"set ngbehavior={mode}\n" if mode else "* no code models are loaded\n"
    deck = CommandDeck("\n".join(lines), {"spinit": start})
    place = make_folder(deck, command_line(simulator), None)
    with Run(
        deck, simulator, place, timeout=seconds, keep=False, bound=PHYSICAL_BOUND, memory=MEMORY
    ) as run:
        return run.accept(_answers)


def _answers(deck: object, ending: Ending) -> Answers:
    said = ending.errors + _text(ending.folder / STREAMS[0])
    try:
        check_end(ending)
        place = ending.folder / RESULT
        plots = tuple(filter(_simulated, read_tables(place))) if place.is_file() else ()
    except (BadEvidence, OutOfDisk, SimulationError) as error:
        plots, said = (), f"error: {str(error).splitlines()[0]}\n{said}"
    return Answers(plots, _text(ending.folder / TEXT), said)


def _simulated(plot: tuple[tuple[str, ...], Complexes]) -> bool:
    """Whether a plot is one of a simulation: a failed one leaves the plot of constants."""
    return "boltz" not in plot[0]


def _text(place: Path) -> str:
    try:
        return read_bounded(place, longest(place.name)).decode("latin-1")
    except UnusableFileError:
        return ""
