"""Macromodels of vendors in a deck's text: which subcircuits they are, and stubs in their place.

Such a subcircuit has transistors, diodes or expressions, and five ports. A stub shows the nodes of
each op-amp in ngspice's listing, and the model that replaces it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from taction.netlist_gen.deck.foreign_deck import LINEAR, Card, ForeignDeck
from taction.netlist_gen.deck.linear_expressions import without_poly
from taction.netlist_gen.deck.ltspice import OPAMPS, missing_cards, opamp_cards, plain_name
from taction.spice_models.foreign_devices import split_fields
from taction.spice_models.foreign_lines import called, check_expanded
from taction.spice_models.imported import ROLES

NOT_LINEAR = re.compile(
    r"^(?:[dqjmsb]|[efgh].*(?:\bpoly\b|\bvalue\b|\btable\b|\bvol\b|\bcur\b|\{v))"
)
EXPRESSIONS = "befgh"  # letters of cards with an expression, which may be linear
PINS = "e_taction_pins_"  # name of the card that stands for an op-amp: its pins and its model
RAILS = "g_taction_rails"  # that of its supplies


@dataclass(slots=True)
class _Block:
    """A subcircuit of the text."""

    head: Card
    cards: list[Card] = field(default_factory=list)

    @property
    def ports(self) -> list[str]:
        """Its ports."""
        words = self.head.text.replace("params:", " ").split()[2:]
        return [word for word in words if "=" not in word]

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


def vendors_of(deck: ForeignDeck, linearise: bool = False) -> tuple[str, ...]:
    """Return the subcircuits to replace; InputError for a device that is not linear elsewhere.

    With `linearise` such a device stays where it is. An expression stays: it may be linear. A deck
    that is too large with all subcircuits expanded is refused.
    """
    blocks, top = _blocks(deck)
    inside = {name: block.cards for name, block in blocks.items()}
    doubtful, vendors = dict[str, Card | None](), list[str]()

    def device(cards: Iterable[Card]) -> Card | None:
        """Return a card that may not be linear, beside replaced op-amps: a device first."""
        found = list[Card]()
        for card in cards:
            name = called(card.text) if card.text[0] == "x" else ""
            if NOT_LINEAR.match(card.text) or (name not in vendors and doubtful.get(name)):
                found.append(doubtful.get(name) or card)
        return min(found, key=lambda card: card.word[0] in EXPRESSIONS, default=None)

    for name in check_expanded(inside, top, tuple(blocks)):
        doubtful[name] = device(blocks[name].cards)
        if doubtful[name] is not None and len(blocks[name].ports) == len(ROLES):
            vendors.append(name)
    check_expanded(inside, top, vendors)
    card = device(top)
    if card and card.word[0] not in EXPRESSIONS and not linearise:
        if card.word[0] == "s":
            raise card.refused(f"a switch is not read; expected an R of its state; {LINEAR}")
        raise card.refused(f"this card is not linear; {LINEAR}, or --linearise")
    return tuple(vendors)


def with_own_parameters(deck: ForeignDeck, vendors: Sequence[str]) -> ForeignDeck:
    """Return a deck in which each call of an op-amp with parameters has a subcircuit of its own."""
    blocks, _ = _blocks(deck)
    made, cards = dict[tuple[str, ...], str](), list[Card]()
    for card in deck.cards:
        name = called(card.text) if card.text[0] == "x" else ""
        if name in vendors and "=" in card.text:
            plain, given = _parameters(card)
            new = made.setdefault((name, *given), f"{name}_taction_{len(made) + 1}")
            cards.append(card.with_text(" ".join((*plain[:-1], new))))
        else:
            cards.append(card)
    for (name, *given), new in made.items():
        block = blocks[name]
        plain, usual = _parameters(block.head)
        values = dict(text.split("=", 1) for text in (*usual, *given))
        fields = [f"{key}={value}" for key, value in values.items()]
        cards.append(block.head.with_text(" ".join((plain[0], new, *plain[2:], *fields))))
        cards += [*block.cards, block.head.with_text(".ends")]
    return replace(deck, cards=tuple(cards))


def _parameters(card: Card) -> tuple[list[str], list[str]]:
    """Return the plain words of a card, and its fields ``key=value`` without blanks around =."""
    try:
        fields = [word for word in split_fields(card.text) if word != "params:"]
    except ValueError as error:
        raise card.refused(str(error)) from None
    given = [re.sub(r"\s*=\s*", "=", word, count=1) for word in fields if "=" in word]
    return [word for word in fields if "=" not in word], given


def with_stubs(deck: ForeignDeck, vendors: Sequence[str]) -> Iterator[str]:
    """Yield the text with a stub in the place of each op-amp, which shows its nodes.

    Before it, what LTspice defines and ngspice does not, where the deck has a word for it.
    """
    yield from missing_cards(deck.lines)[0]
    known = ltspice_opamps(deck)
    for opamp in dict.fromkeys(known.values()):
        yield from opamp_cards(opamp)
    skipping = 0
    for card in deck.cards:
        word, name = card.word, card.text.split()[1:2]
        if skipping:
            skipping += (word == ".subckt") - (word == ".ends")
            if skipping:
                continue
        elif word == ".subckt" and name[0] in vendors:
            inp, inn, vcc, vee, out = _Block(card).ports
            yield f".subckt {name[0]} {inp} {inn} {vcc} {vee} {out}"
            yield f"{PINS}{vendors.index(name[0])} {out} 0 {inp} {inn} 1"
            yield f"{RAILS} {vcc} 0 {vee} 0 1"
            skipping = 1
            continue
        if card in known:
            place = rf"(?<=\s){re.escape(known[card])}(?=\s|$)"
            yield re.sub(place, plain_name(known[card]), card.text)
        else:
            try:
                yield without_poly(card.text)
            except ValueError as error:
                raise card.refused(str(error)) from None


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


def cards_of_models(deck: ForeignDeck) -> Iterator[str]:
    """Yield the cards that the import reads: models, parameters, and subcircuits side by side."""
    blocks, top = _blocks(deck)
    yield from (card.text for card in top if card.word in (".model", ".param"))
    for name, block in blocks.items():
        yield block.head.text
        yield from (card.text for card in block.cards)
        yield f".ends {name}"
