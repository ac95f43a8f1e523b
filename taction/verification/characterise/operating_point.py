"""The operating point of a deck as it is, every transistor and clamp in it, as ngspice finds it.

ngspice expands the deck and finds a first point as it does by itself, then a tight one from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from taction.netlist_gen.deck.elements import SortedCards, sorted_cards
from taction.netlist_gen.deck.flat_cards import CardError
from taction.verification.characterise.element_bench import TIGHT
from taction.verification.engines.ngspice.commands import RESULT, TEXT, Answers, run_commands
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.listing import listed_cards

TRIED = (TIGHT, "reltol=1e-6 abstol=1e-13 vntol=1e-10")
TIGHT_SECONDS = 4.0
AT_ONCE = "optran 1 1 1 0 0 0"  # no transient to the operating point
MODES = ("psa", "")  # PSpice's ways first; what they break is read in ngspice's own
_STEPPED = ("gmin stepping", "source stepping", "Transient op")


@dataclass(frozen=True, slots=True, eq=False)
class DeckPoint:
    """Where a deck rests.

    Attributes
    ----------
    lines : tuple of str
        The deck's text, as ngspice reads it in `mode`.
    cards : tuple of str
        Its flat cards.
    volts : mapping of str to float
        Voltages by node, V, currents by ``name#branch``, A, and what transistors say of themselves.
    limits : str
        Tolerances of ngspice with which it was found.
    """

    lines: tuple[str, ...]
    cards: tuple[str, ...]
    found: SortedCards
    volts: Mapping[str, float]
    limits: str
    options: str
    mode: str

    @property
    def is_tight(self) -> bool:
        """Whether it is known to nine digits."""
        return self.limits == TIGHT

    @property
    def starts(self) -> list[str]:
        """Cards that make ngspice start at this point."""
        return _starts(self.volts)


def find_point(
    lines: Sequence[str], options: str, simulator: Simulator, modes: Sequence[str] = MODES
) -> DeckPoint:
    """Return where a deck rests; it is read in the first of the `modes` that expands it.

    Raises
    ------
    CardError
        ngspice does not expand it, or finds no point; or a card is not read.
    """
    first, mode, said = Answers((), "", ""), "", ""
    cards: tuple[str, ...] = ()
    commands = [f"listing expand > {TEXT}", "save all", "op", f"write {RESULT}"]
    for mode in modes:
        first = run_commands([*lines, *_given(options)], commands, simulator, mode=mode)
        said = said or first.complaint
        if cards := listed_cards(first.listed):
            break
    if not cards:
        raise CardError(f"ngspice does not expand the deck: {said}")
    found = sorted_cards(cards)
    volts = read_volts(first)
    if not found.elements:
        return DeckPoint(tuple(lines), cards, found, {}, TIGHT, options, mode)
    if not volts:
        raise CardError(f"ngspice finds no operating point: {first.complaint}")
    asked = [
        f"@{each.name}[{key}]" for each in found.elements if each.name[0] == "q" and 1 in each.inner
        for key in ("gx", "cbx")
    ]  # fmt: skip
    commands = [AT_ONCE, f"save all {' '.join(asked)}", "op", f"write {RESULT}"]
    limits = "reltol=1e-3"
    for tighter in TRIED:
        text = [*lines, f".options {tighter} {options}", *_starts(volts)]
        answers = run_commands(text, commands, simulator, mode=mode, seconds=TIGHT_SECONDS)
        if tight := read_volts(answers):
            volts, limits = tight, tighter
            break
    return DeckPoint(tuple(lines), cards, found, volts, limits, options, mode)


def _given(options: str) -> list[str]:
    return [f".options {options}"] if options else []


def _starts(volts: Mapping[str, float]) -> list[str]:
    return [
        f".nodeset v({name})={value!r}"
        for name, value in volts.items()
        if not {"#", "@", "["} & set(name)
    ]


def read_volts(answers: Answers) -> dict[str, float]:
    """Return the last operating point that ngspice wrote; nothing where it failed."""
    found = [
        (names, values) for names, values in answers.plots if any(n.startswith("v(") for n in names)
    ]
    if not found:
        return {}
    names, values = found[-1]
    plain = [_plain(name) for name in names]
    return dict(zip(plain, values[-1].real.tolist(), strict=True))


def _plain(name: str) -> str:
    """Return the name of a vector as a node, ``name#branch`` or ``name[key]``."""
    inner = name.lower()
    if inner.startswith(("v(", "i(")) and inner.endswith(")"):
        branch = "#branch" if inner.startswith("i(") and "@" not in inner else ""
        inner = inner[2:-1] + branch
    return inner.removeprefix("@")
