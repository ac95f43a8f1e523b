"""A deck of another hand as a `Circuit`: expanded by ngspice, what is not linear measured alone.

Transistors, clamps or op-amps of vendors are linear about the operating point, at which each is
measured (`operating_point`); they become parts without knobs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.deck.flat_cards import (
    ABSENT,
    ACCEPTED,
    CardError,
    Flat,
    circuit_of,
    read_cards,
    shown,
    spelt_card,
)
from taction.netlist_gen.deck.foreign_deck import ANSWERED, ASKED, ForeignDeck, read_deck
from taction.spice_models.branches import Source
from taction.system.errors import Complaint, DidNotLoad, InputError, first_ones, one_line
from taction.system.processes import one_limit
from taction.verification.characterise.operating_point import (
    MISFIT,
    MODES,
    TIGHT,
    DeckPoint,
    find_point,
    linear_flat,
)
from taction.verification.engines.ngspice.commands import expand
from taction.verification.engines.ngspice.process import find_simulator
from taction.verification.studies.decks.measured_board import Start

REMARKS = {
    "sin": "a sine (sin, sffm) counts with its offset",
    "noise": "noise over time (trnoise, trrandom) does not count: its source has its DC value",
    "repeated": "a pwl that repeats (r=) does not count: its source has its DC value",
}
"""What is said of kinds of sources that are constant here."""
VALUE_SECONDS = 1.0  # that a value of a .param adds to the time of all runs
NAMED = 12  # elements in a note
IN_BRACES = "a value has no blanks, and an expression stands in braces, such as {2*1k}"
_TEMPERATURE = re.compile(r"^\.(?:temp|opt\w* (?:.* )?(?:temp|tnom) ?=) ?(\S+)")
SMALL_STEP = 1e-3  # V or A, of a source of a circuit that is linear about its operating point
BIASED_STEP = 0.01  # of its DC value: the step of a source with AC, within the rails
_OUTPUT = re.compile(r"\bv(?:db|m|p|r|i)?\s*\(\s*([^\s,()]+)\s*\)")
USUAL = ("out", "vout", "output", "vo", "o")  # names of an output, in this order
_OPTION = re.compile(r"\b(gmin|scale) ?= ?([-+\w.]+)")  # that change a circuit


@dataclass(frozen=True, eq=False)
class ForeignBoard:
    """A deck that has been read."""

    deck: ForeignDeck  # its text
    flat: Flat  # its flat cards
    circuit: Circuit  # every part is a knob
    initial: Start  # "zero" for a transient with ``uic``
    notes: tuple[str, ...]  # the step, op-amps that were replaced, what was left out
    point: DeckPoint  # where it rests

    @property
    def is_linear(self) -> bool:
        """Whether nothing in it is measured."""
        return not self.point.flat.elements

    def at(self, name: str, values: Sequence[float]) -> list[Circuit | InputError]:
        """Return the circuit at some values of a ``.param``, an error where there is none.

        One that is not linear has a point of its own at each; others are expanded by one run.
        `InputError`: ngspice does not expand the deck with one of them.
        """

        def measured(value: float) -> Flat:
            lines = (*self.deck.lines, f".param {name}={value!r}")  # of two the last one counts
            return _measured(find_point(lines, _options(self.deck)))[0]

        def circuit(read: Callable[[], Flat]) -> Circuit | InputError:
            try:
                flat, _ = stepped(read(), small=not self.is_linear)
            except (CardError, DidNotLoad) as error:
                return self._error(one_line(error))
            nodes = [out.node for out in self.circuit.outputs]
            return circuit_of(flat, self.circuit.name, nodes)

        if not self.is_linear:
            with one_limit(VALUE_SECONDS * len(values), more=True):
                return [circuit(partial(measured, each)) for each in values]
        changes, mode = [{name: each} for each in values], self.point.mode
        try:
            every = expand(self.deck.lines, find_simulator(), changes, mode)
        except DidNotLoad as error:
            raise self._error(f"with other values of its .param: {one_line(error)}") from None
        return [circuit(partial(read_cards, cards)) for cards in every]

    def _error(self, text: str) -> InputError:
        return InputError(self.deck.file, Complaint("deck", "", text))


def read_board(file: str | Path, outputs: Sequence[str] = ()) -> ForeignBoard:
    """Read a deck as a board with `outputs`, by default those that it shows, or usual names.

    InputError: a card that is not accepted, with its line and what is; a node that is not there.
    SimulationError: ngspice is missing, or does not expand the deck.
    """
    deck = read_deck(file).with_first_steps
    try:
        modes = MODES[-1:] if deck.is_plain else MODES
        point = find_point(deck.lines, _options(deck), modes)
        flat, small = _measured(point)
        made, stimulus = stepped(flat, small=bool(small))
    except (CardError, DidNotLoad) as error:
        said = one_line(error)
        said += f"; {IN_BRACES}" if "unknown parameter" in said else ""
        for card in deck.cards:
            before, _, reason = said.partition(f": {spelt_card(card.text)}: ")
            if reason:
                raise card.refused(f"{before}: {reason}") from None
        of_card = isinstance(error, CardError) and not said.startswith(("ngspice", "the deck"))
        accepted = f"; {ACCEPTED}" if of_card and ACCEPTED not in said else ""
        raise InputError(deck.file, Complaint("deck", "", said + accepted)) from None
    nodes = outputs_of(flat, outputs, (card.text for card in deck.left))
    immediate = any(re.search(r"\buic\b", c.text) for c in deck.left if c.word == ".tran")
    immediate &= not small  # the small signal begins where the circuit rests
    notes = (*([small] if small else ()), stimulus, *_notes(deck, flat, immediate))
    start: Start = "zero" if immediate else "rest"
    return ForeignBoard(deck, made, circuit_of(made, deck.file.stem, nodes), start, notes, point)


def _options(deck: ForeignDeck) -> str:
    """Return the options of a deck that change its circuit."""
    cards = (card.text for card in deck.left if card.word.startswith(".opt"))
    return " ".join(f"{key}={value}" for card in cards for key, value in _OPTION.findall(card))


def _measured(point: DeckPoint) -> tuple[Flat, str]:
    """Return the linear parts of a deck at its operating point, and what was done."""
    flat, elements = point.flat, point.flat.elements
    if not elements:
        return flat, ""
    if not point.text:
        raise CardError("ngspice finds its operating point by a transient only, not from there")
    flat = linear_flat(point)
    within = tuple(f"{each.subcircuit}." for each in elements if each.subcircuit)
    knobs = {name: part for name, part in flat.knobs.items() if not name.startswith(within)}
    places = list(dict.fromkeys(each.subcircuit or shown(each.name) for each in elements))
    names = first_ones(places, NAMED)
    loose = "" if point.limits.startswith(TIGHT) else f" (found with {point.limits} only)"
    return replace(flat, knobs=knobs), (
        f"linear about ngspice's operating point{loose}, for small signals: {names}, measured"
        f" there within {100 * MISFIT:g} %; their own noise does not count, and values of"
        " parts change without moving the point"
    )


def _notes(deck: ForeignDeck, flat: Flat, immediate: bool) -> Iterator[str]:
    """Yield what a reader of a deck should know."""
    if immediate:
        yield "uic: the board starts with no charge"
    yield from deck.remarks
    if words := dict.fromkeys(card.word for card in deck.left if card.word in ASKED):
        yield f"{', '.join(words)}: {ANSWERED}"
    for card in deck.left:
        celsius = _TEMPERATURE.search(card.text)
        if celsius and celsius[1] != "27":
            yield f"{card.text}: does not count; every part is at 27 degrees C"
        if card.word == ".step":  # such as .step param C list 1p 2p
            yield f"{card.text}: does not run; --over NAME=LOW:HIGH:POINTS or NAME=A,B,C does it"
    moving = [source for source in flat.sources if source.step]
    if len({found.at for found in moving}) > 1:
        yield "the sources change at different times; all steps are taken at t = 0"
    if any(found.kind in ("pulse", "pwl", "exp") for found in moving):
        yield "edges are steps: rise times and later edges of the sources do not count"
    kinds = {source.kind for source in flat.sources}
    yield from (text for kind, text in REMARKS.items() if kind in kinds)
    if flat.absent:
        devices = (part.name.partition("#") for part in flat.absent)  # D1#cj is of D1
        names = dict.fromkeys(shown(of if mark else f"c{of}") for of, mark, _ in devices)
        yield f"less than {ABSENT:g} F, so left out: {', '.join(names)}"
    if flat.charged or any(card.word == ".ic" for card in deck.left):
        yield "initial charges (ic=, .ic) do not count"


def outputs_of(flat: Flat, wanted: Sequence[str], shown_cards: Iterable[str]) -> tuple[str, ...]:
    """Return the output nodes: `wanted`, which must be there, or those shown, or the usual ones."""
    nodes = flat.nodes
    if wanted:
        names = [re.sub(r"^v\((.*)\)$", r"\1", name.strip().lower()) for name in wanted]
        for name in names:
            if name not in nodes:
                text = f"the deck has no such node; it has {', '.join(list(nodes)[:20])}"
                raise InputError("--output", Complaint("node", repr(name), text))
        return tuple(dict.fromkeys(names))
    sources, held = [part.nodes for part in flat.parts if part.letter == "V"], {GROUND}
    for _ in sources:  # by one or several in series to ground; others may read currents
        held |= {n for nodes in sources if not held.isdisjoint(nodes) for n in nodes}
    seen = [name for card in shown_cards for name in _OUTPUT.findall(card)]
    known = tuple(dict.fromkeys(n for n in seen if n in nodes and n not in held))
    if known:
        return known
    usual = [name for name in USUAL if name in nodes]
    free = [name for name in nodes if name not in held and not {".", "#"} & set(name)]
    return tuple(usual[:1] or free or list(nodes)[:1])


def stepped(flat: Flat, *, small: bool = False) -> tuple[Flat, str]:
    """Return the parts with a step to show: where no source changes, one that is switched on.

    The sources with an ``ac`` value step from 0 to 1, or by `BIASED_STEP` to the DC value that they
    have; without one of them all are switched on. A `small` signal is a step by `SMALL_STEP` of
    those with an ``ac`` value, else of the last source.
    """
    sources, before, step = flat.sources, 0.0, 0.0
    if moving := [source for source in sources if source.step]:
        return flat, f"step at t = 0: {first_ones([each.label for each in moving])}"
    excited = [source for source in sources if source.ac]
    if small:
        chosen, before, step = excited or sources[-1:], 1.0, SMALL_STEP
        text = f"a step by {SMALL_STEP:g} at t = 0"
    elif chosen := [source for source in excited if source.value]:
        before = 1.0 - BIASED_STEP
        text = f"at t = 0 from {before:.0%} to the DC value"
    else:
        chosen, text = excited or sources, "switched on at t = 0"
        if not any(source.value for source in chosen):  # of an AC analysis: to 1
            step, text = 1.0, "at t = 0 from 0 to 1"
    still = "no source changes over time"
    if not chosen:
        return flat, still if small else ""
    parts = [
        replace(part, before=before * part.value, value=part.value + step)
        if isinstance(part, Source) and part in chosen
        else part
        for part in flat.parts
    ]
    names = first_ones([each.label for each in chosen])
    return replace(flat, parts=parts), f"{still}, so {text}: {names}"
