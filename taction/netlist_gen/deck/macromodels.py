"""The text of a deck for ngspice: its size with all subcircuits, op-amps of LTspice, tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from taction.netlist_gen.deck.foreign_deck import Card, ForeignDeck
from taction.netlist_gen.deck.linear_expressions import without_calls, without_poly, without_table
from taction.netlist_gen.deck.ltspice import OPAMPS, missing_cards, opamp_cards, plain_name
from taction.spice_models.foreign_expressions import number
from taction.spice_models.foreign_lines import called, check_expanded

NOT_LINEAR = re.compile(
    r"^(?:[dqjmswb]|[efgh].*(?:\bpoly\b|\bvalue\b|\btable\b|\bvol\b|\bcur\b|\{v))"
)


_VSWITCH = re.compile(r"\.model (\S+) vswitch\b(.*)")
_FIELD = re.compile(r"(\w+) ?= ?([^\s(),]+)")
_RANGE = {"ron": 1.0, "roff": 1e6, "von": 1.0, "voff": 0.0}  # of PSpice's switch


@dataclass(slots=True)
class _Block:
    """A subcircuit of the text."""

    head: Card
    cards: list[Card] = field(default_factory=list)

    @property
    def texts(self) -> list[str]:
        """The text of its cards."""
        return [card.text for card in (self.head, *self.cards)]


def _blocks(deck: ForeignDeck) -> tuple[dict[str, _Block], list[Card]]:
    """Return the subcircuits by name, and the cards of the top level."""
    blocks, top, inside = dict[str, _Block](), list[Card](), list[_Block]()
    for card in deck.cards:
        if card.word == ".subckt":
            words = card.text.split()
            if len(words) < 2:
                raise card.refused("a subcircuit without a name; expected '.subckt NAME ports'")
            inside.append(_Block(card))
        elif card.word == ".ends":
            if not inside:
                raise card.refused("no subcircuit is open")
            block = inside.pop()
            first = blocks.setdefault(block.head.text.split()[1], block)
            if first.texts != block.texts:
                raise block.head.refused("a second subcircuit of this name, which differs")
        elif inside:
            inside[-1].cards.append(card)
        else:
            top.append(card)
    return blocks, top


def check_size(deck: ForeignDeck, called_one: str = "") -> None:
    """Refuse a deck, or one subcircuit of it, that is too large with all subcircuits expanded.

    Raises
    ------
    InputError
        The card at which a limit is passed.
    """
    blocks, top = _blocks(deck)
    if called_one:
        top = [deck.cards[-1].with_text(f"x {called_one}")]
    known = () if called_one else tuple(blocks)
    check_expanded({name: block.cards for name, block in blocks.items()}, top, known)


def is_plain(deck: ForeignDeck) -> bool:
    """Whether no card of a deck may be other than linear."""
    return not any(NOT_LINEAR.match(card.text) for card in deck.cards)


def ready_lines(deck: ForeignDeck) -> Iterator[str]:
    """Yield the text for ngspice: no POLY, table or VSWITCH, and what others define before it."""
    yield from missing_cards(deck.lines)[0]
    known = ltspice_opamps(deck)
    for opamp in dict.fromkeys(known.values()):
        yield from opamp_cards(opamp)
    switches = _switches(deck)
    for card in deck.cards:
        if card in known:
            place = rf"(?<=\s){re.escape(known[card])}(?=\s|$)"
            yield re.sub(place, plain_name(known[card]), card.text)
        elif not (card.word == ".model" and card.text.split()[1] in switches):
            try:
                text = _smooth_switch(_at_27(card.text), switches)
                yield without_calls(without_table(without_poly(text)))
            except ValueError as error:
                raise card.refused(str(error)) from None


def _switches(deck: ForeignDeck) -> dict[str, dict[str, str]]:
    """Return the fields of PSpice's smooth switches, by the name of their model."""
    found = dict[str, dict[str, str]]()
    for card in deck.cards:
        if match := _VSWITCH.match(card.text):
            fields = dict(_FIELD.findall(match[2]))
            if not {"vt", "vh"} & fields.keys() and found.setdefault(match[1], fields) != fields:
                raise card.refused("a second model of this name, which differs")
    return found


def _smooth_switch(text: str, models: Mapping[str, Mapping[str, str]]) -> str:
    """Return PSpice's switch as a resistance that changes smoothly between two voltages."""
    words = text.split()
    if text[0] != "s" or len(words) != 6 or words[5] not in models:
        return text
    name, a, b, c, d, model = words
    given = {key: number(value) for key, value in models[model].items()}
    if unknown := given.keys() - _RANGE.keys():
        raise ValueError(f"{min(unknown)} of a vswitch is not accepted")
    ron, roff, von, voff = (_RANGE | given).values()
    if not (ron > 0.0 and roff > 0.0 and von != voff):
        raise ValueError("a vswitch needs resistances above 0, and different von and voff")
    # ln R = ln sqrt(Ron Roff) + ln(Ron/Roff) (1.5 x - 2 x³), x from -1/2 to 1/2
    place = f"max(min((v({c},{d})-({0.5 * (von + voff)!r}))/({von - voff!r}),0.5),-0.5)"
    middle, ratio = 0.5 * math.log(ron * roff), math.log(ron / roff)
    power = f"({middle!r})+({ratio!r})*{place}*(1.5-2.0*{place}*{place})"
    return f"b{name} {a} {b} i=v({a},{b})*exp(-({power}))"


def _at_27(text: str) -> str:
    """Return a card with 27 degrees C for ``temp`` in its expressions, which ngspice lacks."""
    return re.sub(r"\btemp(?:er)?\b(?! ?=)", "27", text) if "{" in text else text


def ltspice_opamps(deck: ForeignDeck) -> dict[Card, str]:
    """Return the cards X that call an op-amp of LTspice's library which the deck lacks."""
    own, found = _blocks(deck)[0], dict[Card, str]()
    for card in deck.cards:
        if card.word[0] == "x" and (name := called(card.text)) not in own:
            if name not in OPAMPS:
                text = (
                    f"the deck has no subcircuit {name!r}; put the file with its .subckt into the"
                    f" folder and write '.include FILE'; known without one: {', '.join(OPAMPS)}"
                )
                raise card.refused(text)
            found[card] = name
    return found
