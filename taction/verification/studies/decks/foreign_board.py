"""A deck of another hand as a `Circuit`: expanded by ngspice, what is not linear measured alone.

A deck with transistors, clamps or op-amps of vendors is linear about its operating point, which
ngspice finds for the deck as it is; each such element is measured there (`operating_point`), and
becomes parts without knobs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.elements import ACCEPTED, CardError, shown
from taction.netlist_gen.deck.flat_cards import (
    ABSENT,
    REMARKS,
    Flat,
    circuit_of,
    outputs_of,
    read_cards,
    stepped,
)
from taction.netlist_gen.deck.foreign_deck import (
    LINEAR,
    ForeignDeck,
    read_deck,
    unanswered,
    unbraced_expression,
    with_first_steps,
)
from taction.netlist_gen.deck.foreign_lines import number
from taction.netlist_gen.deck.ltspice import missing_cards
from taction.netlist_gen.deck.vendor_subcircuit import (
    check_size,
    is_plain,
    ltspice_opamps,
    ready_lines,
)
from taction.system.errors import Complaint, DidNotLoad, InputError, one_line
from taction.system.processes import more_time
from taction.verification.characterise.operating_point import (
    MISFIT,
    DeckPoint,
    find_point,
    linear_flat,
)
from taction.verification.engines.ngspice.commands import expand
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.studies.decks.measured_board import Start

MOST_PARTS = 3000  # R C L K E F G H that are not measured
MOST_UNKNOWNS = 600  # of a deck: above it the engine needs the structure of a topology
PROBE = "v_taction_parameter"  # a source whose value is that of a .param
VALUE_SECONDS = 1.0  # that a value of a .param adds to the time of all runs
NAMED = 12  # elements in a note
_TEMPERATURE = re.compile(r"^\.(?:temp|opt\w* (?:.* )?(?:temp|tnom) ?=) ?(\S+)")
_OPTION = re.compile(r"\b(gmin|scale) ?= ?([-+\w.]+)")  # that change a circuit
_CHARGE = re.compile(r"\bic\s*=\s*\S+")  # which does not count


@dataclass(frozen=True, eq=False)
class ForeignBoard:
    """A deck that has been read."""

    deck: ForeignDeck  # its text
    flat: Flat  # its flat cards
    circuit: Circuit  # every part is a knob
    initial: Start  # "zero" for a transient with ``uic``
    notes: tuple[str, ...]  # the step, op-amps that were replaced, what was left out
    lines: tuple[str, ...] = ()  # as ngspice expands them
    point: DeckPoint | None = None  # where a deck rests that is not linear

    @property
    def at_rest(self) -> DeckPoint:
        """Where it rests; of a linear deck, which is the same everywhere, any point."""
        nodes = list(self.flat.nodes)
        return self.point or DeckPoint.of(
            self._ready, self.lines, self.flat, nodes, _options(self.deck)
        )

    @property
    def flat_text(self) -> str:
        """The flat cards as a deck."""
        cards = (_CHARGE.sub("", line) for line in self.lines)
        return "\n".join(["* flat cards of a deck", *cards, ".end", ""])

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the ``.param`` cards that can be moved."""
        return self.deck.parameters

    def at(self, changes: Sequence[Mapping[str, float]]) -> list[Circuit | InputError]:
        """Return the circuit at some values of its ``.param`` cards; of a linear deck by one run.

        Where a value gives no circuit, its error is in the place; `InputError` where ngspice does
        not expand the deck with one of them.
        """
        if self.point is not None:
            with more_time(VALUE_SECONDS * len(changes)):
                return [self._with(partial(self._measured_at, each)) for each in changes]
        try:
            every = expand(self._ready, find_simulator(), changes)
        except DidNotLoad as error:
            text = f"with other values of its .param: {one_line(error)}"
            raise InputError(self.deck.file, Complaint("deck", "", text)) from None
        return [self._with(partial(read_cards, cards)) for cards in every]

    def _with(self, read: Callable[[], Flat]) -> Circuit | InputError:
        """Return the circuit of other flat cards, or why there is none."""
        try:
            flat, _ = stepped(read(), small=self.point is not None)
        except CardError as error:
            return InputError(self.deck.file, Complaint("deck", "", str(error)))
        return circuit_of(flat, self.circuit.name, [out.node for out in self.circuit.outputs])

    def _measured_at(self, changed: Mapping[str, float]) -> Flat:
        """Return the parts at other values of the ``.param`` cards, at an own point."""
        lines = [_with_values(line, changed) for line in self._ready]
        return _measured_flat(find_point(lines, _options(self.deck), find_simulator()))[0]

    def value_of(self, parameter: str) -> float | None:
        """Return the value of a ``.param``, as ngspice computes it; None if it is no number."""
        probe = f"{PROBE} {PROBE} 0 {{{parameter}}}"
        try:
            (cards,) = expand((*self._ready, probe), find_simulator())
            (found,) = (card for card in cards if card.startswith(PROBE))
            return number(found.split()[-1])
        except (DidNotLoad, ValueError):
            return None

    @cached_property
    def _ready(self) -> tuple[str, ...]:
        return tuple(ready_lines(self.deck))


def read_board(file: str | Path, outputs: Sequence[str] = ()) -> ForeignBoard:
    """Read a deck as a board.

    `outputs`: nodes of interest; by default those that the deck shows, else the usual names of
      outputs.
    InputError: a card that is not accepted, with its line and what is; a node that is not there.
    SimulationError: ngspice is missing, or does not expand the deck.
    """
    deck = with_first_steps(read_deck(file))
    check_size(deck)
    ready, point, small = tuple(ready_lines(deck)), None, ""
    try:
        if plain := is_plain(deck):
            (cards,) = expand(ready, find_simulator())
            flat = read_cards(cards, measure=True)
            plain = not flat.elements
        if not plain:
            point = find_point(ready, _options(deck), find_simulator())
            cards, (flat, small) = point.cards, _measured_flat(point)
            point = point if small else None
        flat, stimulus = stepped(flat, small=point is not None)
    except (CardError, DidNotLoad) as error:
        refused = unbraced_expression(deck) if "unknown parameter" in str(error) else None
        said = one_line(error)
        whole = isinstance(error, DidNotLoad) or said.startswith("ngspice") or ACCEPTED in said
        accepted = "" if whole else f"; {LINEAR}"
        raise refused or InputError(deck.file, Complaint("deck", "", said + accepted)) from None
    nodes = outputs_of(flat, outputs, (card.text for card in deck.left))
    if len(flat.nodes) > MOST_UNKNOWNS:
        text = f"the deck has {len(flat.nodes)} nodes; up to {MOST_UNKNOWNS} are read"
        raise InputError(deck.file, Complaint("deck", "", text))
    if len(flat.knobs) > MOST_PARTS:
        text = f"the deck has {len(flat.knobs)} parts; up to {MOST_PARTS} are read"
        raise InputError(deck.file, Complaint("deck", "", text))
    circuit = circuit_of(flat, deck.file.stem, nodes)
    immediate = any(re.search(r"\buic\b", c.text) for c in deck.left if c.word == ".tran")
    immediate &= point is None  # the small signal begins where the circuit rests
    notes = (*([small] if small else ()), stimulus, *_notes(deck, flat, immediate))
    start: Start = "zero" if immediate else "rest"
    return ForeignBoard(deck, flat, circuit, start, notes, tuple(cards), point)


def _options(deck: ForeignDeck) -> str:
    """Return the options of a deck that change its circuit."""
    words = [f"{key}={value}" for card in deck.left if card.word.startswith(".opt")
             for key, value in _OPTION.findall(card.text)]  # fmt: skip
    return " ".join(words)


def _with_values(line: str, changed: Mapping[str, float]) -> str:
    """Return a card ``.param`` with other values."""
    if line.startswith(".param"):
        for name, value in changed.items():
            own = rf"\b{re.escape(name)} ?=(?!=) ?(?:\{{[^{{}}]*\}}|\S+)"
            line = re.sub(own, f"{name}={value!r}", line)
    return line


def _measured_flat(point: DeckPoint) -> tuple[Flat, str]:
    """Return the linear parts of a deck at its operating point, and what was done."""
    flat, elements = point.flat, point.flat.elements
    if not elements:
        return flat, ""
    if not point.text:
        raise CardError("ngspice finds its operating point by a transient only, not from there")
    flat = linear_flat(flat, point.volts, point.options, find_simulator())
    within = tuple(f"{each.subcircuit}." for each in elements if each.subcircuit)
    knobs = {name: part for name, part in flat.knobs.items() if not name.startswith(within)}
    places = list(dict.fromkeys(each.subcircuit or shown(each.name) for each in elements))
    names = ", ".join(places[:NAMED])
    names += f" and {len(places) - NAMED} more" * (len(places) > NAMED)
    loose = "" if point.is_tight else f" (found with {point.limits} only)"
    return replace(flat, knobs=knobs), (
        f"linear about ngspice's operating point{loose}, for small signals: {names}, measured"
        f" there within {100 * MISFIT:g} %; their own noise does not count, and values of"
        " parts change without moving the point"
    )


def _notes(deck: ForeignDeck, flat: Flat, immediate: bool) -> Iterator[str]:
    if immediate:
        yield "uic: the board starts with no charge"
    yield from deck.remarks
    yield from unanswered(deck)
    for name in dict.fromkeys(ltspice_opamps(deck).values()):
        yield (
            f"{name}: the linear part of LTspice's op-amp of this name, its gain, bandwidth and"
            " phase margin; its limits and its noise do not count"
        )
    for name in missing_cards(deck.lines)[1]:
        yield f"{name}(): a drawn value counts with its nominal one; --tolerances draws"
    for card in deck.left:
        celsius = _TEMPERATURE.search(card.text)
        if celsius and celsius[1] != "27":
            yield f"{card.text}: does not count; every part is at 27 degrees C"
        if card.word == ".step":
            yield f"{card.text}: does not run; {_sweep_of(card.text)} does it"
    times = {found.at for found in flat.stimuli.values() if found.moves}
    if len(times) > 1:
        yield "the sources change at different times; all steps are taken at t = 0"
    if any(
        found.kind in ("pulse", "pwl", "exp") and found.moves for found in flat.stimuli.values()
    ):
        yield "edges are steps: rise times and later edges of the sources do not count"
    kinds = {found.kind for found in flat.stimuli.values()}
    yield from (text for kind, text in REMARKS.items() if kind in kinds)
    if flat.absent:
        yield f"less than {ABSENT:g} F, so left out: {', '.join(flat.absent)}"
    if flat.charged or any(card.word == ".ic" for card in deck.left):
        yield "initial charges (ic=, .ic) do not count"


def _sweep_of(text: str) -> str:
    """Return the option that sweeps as a card ``.step`` does."""
    words = [w for w in text.split()[1:] if w not in ("param", "lin", "dec", "oct", "temp")]
    name, values = words[:1], words[1:]
    if values[:1] == ["list"] and len(values) > 1:
        return f"--over {name[0]}={','.join(values[1:])}"
    return f"--over {name[0]}={':'.join(values[:2])}" if len(values) > 1 else "--over"
