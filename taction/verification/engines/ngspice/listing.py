"""A deck as ngspice expands it: subcircuits flattened, every expression a number.

The text comes from `taction.netlist_gen.deck.foreign_deck`, which accepts no card that runs
anything; the only commands of the run are those that list it. There is no simulation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from taction.netlist_gen.analysis import Analysis, OperatingPoint
from taction.system.errors import DidNotLoad
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.system.time_limit import time_left
from taction.system.waveforms import PHYSICAL_BOUND
from taction.verification.engines.ngspice.evidence import Ending, check_end, longest
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import (
    Run,
    command_line,
    make_folder,
)

LISTED = "listed.txt"
LIST = f"listing expand >> {LISTED}"
LAST = ".end\n"  # of a listing
LONGEST_CARD = 4000  # characters: a longer one is listed without its end
SECONDS = 20.0  # of an expansion, which takes some milliseconds
MEMORY = 1000 * MEGABYTE  # addresses of ngspice: an expansion of 20,000 devices takes 100 MB
_CARD = re.compile(r"^ *\d+ : (\S.*)$")
_HEAD = re.compile(r"^\t\S", re.M)  # of a listing: the title
_WRONG = re.compile(r"^(?:Error|Cannot|Undefined|Too few|Unknown|.*[Ee]rror).*$", re.M)
_REFUSED = re.compile(r"^Error on line \d+ or its substitute:\n\s*(\S.*)\n\s*(\S.*)$", re.M)
_PLACE = re.compile(r"Error in netlist line no\.")
SHOWN = 5  # lines of an error


@dataclass(frozen=True, slots=True)
class _Listing:
    """A text that is only listed."""

    text: str
    files: Mapping[str, str] = field(default_factory=dict)
    saved: tuple[str, ...] = ()
    analysis: Analysis = field(default_factory=OperatingPoint)


def expand(
    lines: Iterable[str],
    simulator: Simulator,
    values: Sequence[Mapping[str, float]] = ({},),
    seconds: float = SECONDS,
) -> tuple[tuple[str, ...], ...]:
    """Return the flat cards of a deck, for each of some values of its parameters.

    Parameters
    ----------
    lines : iterable of str
        Cards, one a line, checked before.
    values : sequence of mapping
        Numbers for ``.param`` names, in the place of the deck's own.
    seconds : float
        Time allowed, s.

    Raises
    ------
    DidNotLoad
        ngspice does not expand the deck; the text has what it said.
    """
    commands = []
    for changed in values:
        commands += [f"alterparam {name}={value!r}" for name, value in changed.items()]
        commands += ["reset"] if changed else []
        commands.append(LIST)
    with _listing(lines, commands, simulator, seconds) as run:
        found = _accepted(run)
    if len(found) != len(values):
        raise DidNotLoad(f"ngspice listed {len(found)} of {len(values)} decks")
    return found


def _listing(
    lines: Iterable[str],
    commands: Iterable[str],
    simulator: Simulator,
    seconds: float,
) -> Run:
    """Start ngspice with a deck and commands."""
    if not (seconds := time_left(seconds)):
        raise DidNotLoad("the time that all runs of ngspice have together is over")
    deck = _Listing("\n".join(["* deck", *lines, ".control", *commands, ".endc", ".end", ""]))
    place = make_folder(deck, command_line(simulator), None)
    return Run(
        deck,
        simulator,
        place,
        timeout=seconds,
        keep=False,
        bound=PHYSICAL_BOUND,
        memory=MEMORY,
    )


def _accepted(run: Run) -> tuple[tuple[str, ...], ...]:
    """Return the cards of every listing."""
    found = run.accept(_listings)
    if isinstance(found, DidNotLoad):
        raise found
    return found


def _read(folder: Path) -> str:
    """Return what is listed up to now."""
    try:
        return read_bounded(folder / LISTED, longest(LISTED)).decode("latin-1")
    except UnusableFileError:
        return ""


def _listings(deck: object, ending: Ending) -> tuple[tuple[str, ...], ...] | DidNotLoad:
    """Return the cards of every listing, or why there are none; nothing is kept of a refusal.

    The exit status says only that nothing was simulated.
    """
    check_end(ending)
    found = [listed_cards(part) for part in _HEAD.split(_read(ending.folder))[1:]]
    text = re.split(r"incomplete or empty netlist", ending.errors)[0]
    wrong = [": ".join(each) for each in _REFUSED.findall(text)] or _WRONG.findall(
        re.sub(r"Error: $", "", text.strip())
    )
    if wrong or not all(found):
        lines = dict.fromkeys(line.strip() for line in wrong)  # places are of the text as written
        said = "; ".join([each for each in lines if not _PLACE.match(each)][:SHOWN])
        said = said or next(iter(lines), "it lists no card")
        return DidNotLoad(f"ngspice does not expand the deck: {said}")
    return tuple(found)


def listed_cards(part: str) -> tuple[str, ...]:
    """Return the flat cards of one listing.

    Raises
    ------
    DidNotLoad
        A card is so long that it may be listed without its end.
    """
    cards = [match[1] for line in part.split("\n") if (match := _CARD.match(line))]
    for card in cards:
        if len(card) > LONGEST_CARD and card[0] in "befgh":
            name = card.split(maxsplit=1)[0].capitalize()
            raise DidNotLoad(f"{name}: too many terms: ngspice lists 4,000 characters of a card")
    return tuple(" ".join(card.split()) for card in cards if not card.startswith((".end", "*")))
