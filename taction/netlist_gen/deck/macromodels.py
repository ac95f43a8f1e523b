"""The text of a deck for ngspice: its size with all subcircuits, op-amps of LTspice, tables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from taction.netlist_gen.deck.foreign_deck import ForeignDeck
from taction.netlist_gen.deck.foreign_lines import Card, called, check_expanded, subcircuits
from taction.netlist_gen.deck.linear_expressions import without_calls, without_poly, without_table
from taction.netlist_gen.deck.ltspice import OPAMPS, missing_cards, opamp_cards, plain_name
from taction.spice_models.foreign_expressions import number
from taction.system.errors import Complaint, InputError

NOT_LINEAR = re.compile(
    r"^(?:[dqjmswb]|[efgh].*(?:\bpoly\b|\bvalue\b|\btable\b|\bvol\b|\bcur\b|\{v))"
)


_SMOOTH = re.compile(r"\.model (\S+) ([vi])switch\b(.*)")
_FIELD = re.compile(r"(\w+) ?= ?(\{[^{}]*\}|[^\s(),]+)")
_RANGES = {
    "v": {"ron": "1", "roff": "1meg", "von": "1", "voff": "0"},
    "i": {"ron": "1", "roff": "1meg", "ion": "1m", "ioff": "0"},
}
"""Of PSpice's switches, by what controls them, with its values."""
_GROUND = re.compile(r"(?<=[\s(,])gnd(?=[\s),]|$)(?! ?=)")
Scope = tuple[str, ...]  # subcircuits, from the outermost one


def check_size(deck: ForeignDeck, called_one: str = "") -> None:
    """Refuse a deck, or one subcircuit of it, that is too large with all subcircuits expanded."""
    blocks, top = subcircuits(deck.cards)
    if not called_one and not any(card.text[0].isalpha() for card in top):
        text = "has no part outside its subcircuits; expected a circuit, which may call them (X)"
        raise InputError(deck.file, Complaint("deck", "", text))
    if called_one:
        top = [deck.cards[-1].with_text(f"x {called_one}")]
    check_expanded(blocks, top, within=bool(called_one))


def is_plain(deck: ForeignDeck) -> bool:
    """Whether no card of a deck may be other than linear."""
    return not any(NOT_LINEAR.match(card.text) for card in deck.cards)


def ready_lines(deck: ForeignDeck) -> Iterator[str]:
    """Yield the text for ngspice: no POLY, table or PSpice's switch; what it lacks before it."""
    yield from missing_cards(deck.lines)[0]
    known = ltspice_opamps(deck)
    for opamp in dict.fromkeys(known.values()):
        yield from opamp_cards(opamp)
    switches = {
        (scope, m[1]): m for scope, card in _scoped(deck) if (m := _smooth_model(card.text))
    }
    own = {scope for scope, card in _scoped(deck)
           if card.word == ".subckt" and "gnd" in card.text.split()}  # fmt: skip
    for scope, card in _scoped(deck):
        inner = scope and scope not in own  # there PSpice has it as another node
        text = _GROUND.sub("0", card.text) if inner else card.text
        if card in known:
            place = rf"(?<=\s){re.escape(known[card])}(?=\s|$)"
            yield re.sub(place, plain_name(known[card]), text)
        elif not _smooth_model(text):
            try:
                text = _smooth_switch(_at_27(text), scope, switches)
                yield without_calls(without_table(without_poly(text)))
            except ValueError as error:
                raise card.refused(str(error)) from None


def _scoped(deck: ForeignDeck) -> Iterator[tuple[Scope, Card]]:
    """Yield the cards with the subcircuits in which they stand."""
    scope: Scope = ()
    for card in deck.cards:
        if card.word == ".subckt":
            scope = (*scope, card.text.split()[1])
        yield scope, card
        if card.word == ".ends":
            scope = scope[:-1]


def _smooth_model(text: str) -> re.Match[str] | None:
    """Return the model of a switch of PSpice; one with thresholds is ngspice's own."""
    match = _SMOOTH.match(text)
    own = match and {"vt", "vh", "it", "ih"} & dict(_FIELD.findall(match[3])).keys()
    return None if own else match


def _smooth_switch(
    text: str, scope: Scope, models: Mapping[tuple[Scope, str], re.Match[str]]
) -> str:
    """Return PSpice's switch as a resistance that changes smoothly with what controls it."""
    name, *words = text.split()
    if text[0] not in "sw" or len(words) != {"s": 5, "w": 4}[text[0]]:
        return text
    places = (scope[:k] for k in range(len(scope), -1, -1))
    match = next((m for place in places if (m := models.get((place, words[-1])))), None)
    if match is None:
        return text
    kind, given = match[2], dict(_FIELD.findall(match[3]))
    if unknown := given.keys() - _RANGES[kind].keys():
        raise ValueError(f"{min(unknown)} of a {kind}switch is not accepted")
    ron, roff, on, off = (_plain_value(each) for each in (_RANGES[kind] | given).values())
    if on == off or any(each.startswith("-") or each == "0.0" for each in (ron, roff)):
        raise ValueError(f"a {kind}switch needs resistances above 0, and two ends that differ")
    control = f"v({words[2]},{words[3]})" if kind == "v" else f"i({words[2]})"
    # ln R = ln sqrt(Ron Roff) + ln(Ron/Roff) (1.5 x - 2 x³), x from -1/2 to 1/2
    place = f"max(min(({control}-0.5*({on}+{off}))/({on}-{off}),0.5),-0.5)"
    power = f"0.5*log({ron}*{roff})+log({ron}/{roff})*{place}*(1.5-2.0*{place}*{place})"
    return f"b{name} {words[0]} {words[1]} i=v({words[0]},{words[1]})*exp(-({power}))"


def _plain_value(text: str) -> str:
    """Return a number in plain digits, or an expression in its braces."""
    return text if text.startswith("{") else repr(number(text))


def _at_27(text: str) -> str:
    """Return a card with 27 degrees C for ``temp`` in its expressions, which ngspice lacks."""
    return re.sub(r"\btemp(?:er)?\b(?! ?=)", "27", text) if "{" in text else text


def ltspice_opamps(deck: ForeignDeck) -> dict[Card, str]:
    """Return the cards X that call an op-amp of LTspice's library which the deck lacks."""
    own, found = subcircuits(deck.cards)[0], dict[Card, str]()
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
