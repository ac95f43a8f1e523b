"""A run of ngspice with commands: what it listed, wrote and said; a deck as ngspice expands it.

The cards come from `taction.netlist_gen.deck.foreign_deck`, which accepts none that runs anything
or names a file; no code model is loaded, standard input is closed, and one limit of time holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taction.netlist_gen.analysis import OperatingPoint, SimulatedDeck
from taction.system.array_types import Complexes
from taction.system.errors import DidNotLoad, SimulationError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.system.processes import time_left
from taction.system.raw_file import KINDS, read_plots
from taction.verification.engines.ngspice.evidence import Ending, check_end
from taction.verification.engines.ngspice.process import STREAMS, Simulation, Simulator

SECONDS = 20.0
MEMORY = 1000 * MEGABYTE  # addresses of ngspice: an expansion of 20,000 devices takes 100 MB
LONGEST_TEXT = 100 * MEGABYTE  # of what it lists or says
RESULT = "result.raw"
TEXT = "listed.txt"
LIST = f"listing expand >> {TEXT}"
LONGEST_CARD = 4000  # characters: a longer one is listed without its end
SHOWN = 5  # lines of a complaint
OVER = "the time that all runs of ngspice have together is over"
_COMPLAINT = re.compile(
    r"^(?!.*(?:Note:|incomplete or empty|netlist line no)).*"
    r"(?:[Ee]rror|annot|ndefined|nknown|ailed|[Tt]oo few|no such|singular).*$",
    re.M,
)
_CARD = re.compile(r"^ *\d+ : (\S.*)$")
_HEAD = re.compile(r"^\t\S", re.M)  # of a listing: the title
_WRONG = re.compile(r"^(?:Error|Cannot|Undefined|Too few|Unknown|.*[Ee]rror).*$", re.M)
_REFUSED = re.compile(r"^Error on line \d+ or its substitute:\n\s*(\S.*)\n\s*(\S.*)$", re.M)
_PLACE = re.compile(r"Error in netlist line no\.")


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What ngspice wrote with ``write``, plot by plot, what it listed, and what it said.

    `failure` is why there is nothing to read; `errors` is the error stream.
    """

    plots: tuple[dict[str, Complexes], ...] = ()  # vectors by name, in lower case
    listed: str = ""
    said: str = ""
    errors: str = ""
    failure: SimulationError | None = None

    @property
    def complaint(self) -> str:
        """The lines that tell what is wrong."""
        said = f"error: {str(self.failure).splitlines()[0]}\n" if self.failure else ""
        lines = dict.fromkeys(line.strip() for line in _COMPLAINT.findall(said + self.said))
        return "; ".join(list(lines)[:SHOWN])[:400] or "it says nothing"


def run_commands(
    cards: Iterable[str],
    commands: Sequence[str],
    simulator: Simulator,
    *,
    mode: str = "",
    seconds: float = SECONDS,
    last: str = "quit",
) -> Answers:
    """Run commands on cards.

    `cards`: one a line, checked before.
    `commands`: they write plots into `RESULT` and listings into `TEXT`.
    `mode`: of ngspice's ``ngbehavior``, such as ``"psa"``; empty for its own.
    `seconds`: time allowed, s; less where `taction.system.processes` leaves less.
    `last`: the last command; without ``quit`` ngspice then sets the circuit up, and checks it.
    """
    if not (seconds := time_left(seconds)):
        return Answers(failure=DidNotLoad(OVER))
    lines = ["* deck", *cards, ".control", *commands, last, ".endc", ".end", ""]
    spinit = f"set ngbehavior={mode}\n" if mode else "* no code models are loaded\n"
    deck = SimulatedDeck("\n".join(lines), (), OperatingPoint(), {"spinit": spinit})
    with Simulation(deck, simulator, timeout=seconds, memory=MEMORY) as run:
        return run.accept(_answers)


def _answers(deck: object, ending: Ending) -> Answers:
    said = ending.errors + _text(ending.folder / STREAMS[0])
    listed = _text(ending.folder / TEXT)
    try:
        check_end(ending)
        place = ending.folder / RESULT
        plots = read_plots(place, flags=tuple(KINDS)) if place.is_file() else []
    except SimulationError as error:
        return Answers((), listed, said, ending.errors, error)
    # A failed simulation leaves the plot of constants.
    simulated = [plot for plot in plots if "boltz" not in plot.vectors]
    tables = (zip(map(str.lower, p.vectors), p.data.T, strict=True) for p in simulated)
    found = tuple({name: data.astype(np.complex128) for name, data in each} for each in tables)
    return Answers(found, listed, said, ending.errors)


def _text(place: Path) -> str:
    try:
        return read_bounded(place, LONGEST_TEXT).decode("latin-1")
    except UnusableFileError:
        return ""


def expand(
    lines: Iterable[str],
    simulator: Simulator,
    values: Sequence[Mapping[str, float]] = ({},),
    mode: str = "",
    seconds: float = SECONDS,
) -> tuple[tuple[str, ...], ...]:
    """Return the flat cards of a deck, for each of some values of its parameters.

    Subcircuits are flattened, and every expression is a number; nothing is simulated.

    `lines`: cards, one a line, checked before.
    `values`: numbers for ``.param`` names, in the place of the deck's own.
    `mode`, `seconds`: as of `run_commands`.
    SimulationError: ngspice does not expand the deck; the text has what it said.
    """
    commands: list[str] = []
    for changed in values:
        commands += [f"alterparam {name}={value!r}" for name, value in changed.items()]
        commands += ["reset", LIST] if changed else [LIST]
    *others, last = commands
    answers = run_commands(lines, others, simulator, mode=mode, seconds=seconds, last=last)
    if answers.failure is not None:
        raise answers.failure
    found = tuple(listed_cards(part) for part in _HEAD.split(answers.listed)[1:])
    text = re.split(r"incomplete or empty netlist", answers.errors)[0]
    wrong = [": ".join(each) for each in _REFUSED.findall(text)] or _WRONG.findall(
        re.sub(r"Error: $", "", text.strip())
    )
    if wrong or not all(found):
        said = dict.fromkeys(line.strip() for line in wrong)  # places are of the text as written
        shown = "; ".join([each for each in said if not _PLACE.match(each)][:SHOWN])
        shown = shown or next(iter(said), "it lists no card")
        raise DidNotLoad(f"ngspice does not expand the deck: {shown}")
    if len(found) != len(values):
        raise DidNotLoad(f"ngspice listed {len(found)} of {len(values)} decks")
    return found


def listed_cards(part: str) -> tuple[str, ...]:
    """Return the flat cards of one listing.

    DidNotLoad: a card is so long that it may be listed without its end.
    """
    cards = [match[1] for line in part.split("\n") if (match := _CARD.match(line))]
    for card in cards:
        if len(card) > LONGEST_CARD and card[0] in "befgh":
            name = card.split(maxsplit=1)[0].capitalize()
            raise DidNotLoad(f"{name}: too many terms: ngspice lists 4,000 characters of a card")
    return tuple(" ".join(card.split()) for card in cards if not card.startswith((".end", "*")))
