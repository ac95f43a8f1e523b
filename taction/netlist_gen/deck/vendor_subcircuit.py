"""The text of a vendor's subcircuit, and of a deck with macromodels: as ngspice reads it, and flat.

ngspice expands the bench; what is kept are the flat cards of its listing, in ngspice's own words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from taction.netlist_gen.deck.elements import spelt_card
from taction.netlist_gen.deck.expressions import without_calls, without_poly, without_table
from taction.netlist_gen.deck.foreign_deck import LETTERS, ForeignDeck, forbidden, read_library
from taction.netlist_gen.deck.foreign_lines import (
    MOST_CARDS,
    Card,
    called,
    logical_lines,
    number,
    subcircuits,
)
from taction.netlist_gen.deck.ltspice import OPAMPS, missing_cards, opamp_cards, plain_name
from taction.spice_models.imported import DEVICE, Subcircuit

NOT_LINEAR = re.compile(
    r"^(?:[dqjmswb]|[efgh].*(?:\bpoly\b|\bvalue\b|\btable\b|\bvol\b|\bcur\b|\{v))"
)
# Switches of PSpice; those with thresholds are ngspice's own.
_SMOOTH = re.compile(r"\.model (\S+) ([vi])switch\b(?!.*\b[vi][th] ?=)(.*)")
_FIELD = re.compile(r"(\w+) ?= ?(\{[^{}]*\}|[^\s(),]+)")
_RANGES = {
    "v": {"ron": "1", "roff": "1meg", "von": "1", "voff": "0"},
    "i": {"ron": "1", "roff": "1meg", "ion": "1m", "ioff": "0"},
}
"""Of PSpice's switches, by what controls them, with its values."""
_GROUND = re.compile(r"(?<=[\s(,])gnd(?=[\s),]|$)(?! ?=)")


def is_plain(deck: ForeignDeck) -> bool:
    """Whether no card of a deck may be other than linear."""
    return not any(NOT_LINEAR.match(card.text) for card in deck.cards)


def ready_lines(deck: ForeignDeck) -> Iterator[str]:
    """Yield the text for ngspice: no POLY, table or PSpice's switch; what it lacks before it."""
    yield from missing_cards(deck.lines)[0]
    known, inside = ltspice_opamps(deck), list[str]()
    for opamp in dict.fromkeys(known.values()):
        yield from opamp_cards(opamp)
    placed = list[tuple[tuple[str, ...], Card]]()  # with the subcircuits in which it stands
    for card in deck.cards:
        inside += [card.text.split()[1]] if card.word == ".subckt" else []
        placed.append((tuple(inside), card))
        del inside[len(inside) - (card.word == ".ends") :]
    models = {(scope, m[1]): m for scope, card in placed if (m := _SMOOTH.match(card.text))}
    own = {s for s, card in placed if card.word == ".subckt" and "gnd" in card.text.split()}
    for scope, card in placed:
        text = card.text
        if scope and scope not in own:  # there PSpice has it as another node
            text = _GROUND.sub("0", text)
        if card in known:
            place = rf"(?<=\s){re.escape(known[card])}(?=\s|$)"
            yield re.sub(place, plain_name(known[card]), text)
        elif not _SMOOTH.match(text):
            if "{" in text:  # ngspice lacks the temperature
                text = re.sub(r"\btemp(?:er)?\b(?! ?=)", "27", text)
            places = ((scope[:k], text.split()[-1]) for k in range(len(scope), -1, -1))
            model = next((m for place in places if (m := models.get(place))), None)
            try:
                text = _smooth_switch(text, model) if model else text
                yield without_calls(without_table(without_poly(text)))
            except ValueError as error:
                raise card.refused(str(error)) from None


def _smooth_switch(text: str, model: re.Match[str]) -> str:
    """Return PSpice's switch as a resistance that changes smoothly with what controls it."""
    name, *words = text.split()
    if text[0] not in "sw" or len(words) != {"s": 5, "w": 4}[text[0]]:
        return text
    kind, given = model[2], dict(_FIELD.findall(model[3]))
    if unknown := given.keys() - _RANGES[kind].keys():
        raise ValueError(f"{min(unknown)} of a {kind}switch is not accepted")
    every = (_RANGES[kind] | given).values()
    ron, roff, on, off = (each if each[0] == "{" else repr(number(each)) for each in every)
    if on == off or any(each.startswith("-") or each == "0.0" for each in (ron, roff)):
        raise ValueError(f"a {kind}switch needs resistances above 0, and two ends that differ")
    control = f"v({words[2]},{words[3]})" if kind == "v" else f"i({words[2]})"
    # ln R = ln sqrt(Ron Roff) + ln(Ron/Roff) (1.5 x - 2 x³), x from -1/2 to 1/2
    place = f"max(min(({control}-0.5*({on}+{off}))/({on}-{off}),0.5),-0.5)"
    power = f"0.5*log({ron}*{roff})+log({ron}/{roff})*{place}*(1.5-2.0*{place}*{place})"
    return f"b{name} {words[0]} {words[1]} i=v({words[0]},{words[1]})*exp(-({power}))"


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


_NUMBER = re.compile(r"(?:(?<=^\.model )\S+|(?<=[ =(])[-+]?[\d.]+(?:e[-+]?\d+)?[a-z]*(?=[ )]|$))")


def vendor_subcircuit(file: str | Path, name: str) -> Subcircuit:
    """Return a subcircuit of a vendor's file as text for ngspice in PSpice's ways.

    Subcircuits get other names: ngspice does not find one whose name has a sign such as '/'.
    """
    deck, own = read_library(file, name), name.lower()
    deck.check_size(own)
    heads = [line for line in deck.lines if line.startswith(".subckt ")]
    new = {head.split()[1]: f"m{k}" for k, head in enumerate(heads)}
    (head,) = [line for line in heads if line.split()[1] == own]
    words = re.sub(r" ?= ?", "=", head).split()[2:]
    ports = tuple(word for word in words if "=" not in word and word != "params:")
    lines = list[str]()
    for text in ready_lines(deck):
        words, is_call = re.sub(r" ?= ?", "=", text).split(), text[0] == "x"
        old = called(text) if is_call else "".join(words[1:2])
        if old in new and (is_call or words[0] in (".subckt", ".ends")):
            words[max(k for k, word in enumerate(words) if word == old) if is_call else 1] = new[
                old
            ]
            text = " ".join(words)
        lines.append(text)
    return Subcircuit(new[own], ports, tuple(lines))


def flat_subcircuit(cards: Iterable[str], nodes: Sequence[str], name: str) -> Subcircuit:
    """Return the subcircuit of a bench, its ports at `nodes`, from the cards of its listing."""

    def plain(match: re.Match[str]) -> str:
        """Return a number in plain digits; a name as it is."""
        with suppress(ValueError):
            return repr(number(match[0])) if set(match[0]) & set(".e") else match[0]
        return match[0]

    own = [spelt_card(card) for card in cards]
    own = [card if card[0] in "dqjmsw" else _NUMBER.sub(plain, card) for card in own]
    own = [c for c in own if c.startswith(".model ") or f".{DEVICE}." in c.split(maxsplit=1)[0]]
    return _subcircuit(f"m_{re.sub(r'[^a-z0-9]', '_', name.lower())}", nodes, own)


def stored_subcircuit(lines: Sequence[str], name: str, prefix: str) -> Subcircuit:
    """Return the flat subcircuit of a file of ours, checked; its name gets a `prefix`."""
    found = logical_lines("\n".join(lines))
    cards = found.cards
    words = [card.text.split() for card in (*cards[:1], *cards[-1:])]
    if not words or words[0][:2] != [".subckt", name] or words[-1][0] != ".ends":
        raise Card(1, "", "netlist").refused(f"expected a whole subcircuit {name!r}")
    if found.remarks:
        raise cards[0].refused(found.remarks[0])
    cards[-1].limited(len(cards), "cards", MOST_CARDS)
    for card in cards[1:-1]:
        if card.word != ".model" and card.text[0] not in LETTERS.replace("x", ""):
            raise card.refused(f"the card {card.word!r} is not accepted; expected flat cards")
        if reason := forbidden(card.text):
            raise card.refused(reason)
    return _subcircuit(f"{prefix}_{name}", words[0][2:], (card.text for card in cards[1:-1]))


def _subcircuit(name: str, ports: Sequence[str], cards: Iterable[str]) -> Subcircuit:
    text = (f".subckt {name} {' '.join(ports)}", *cards, f".ends {name}")
    return Subcircuit(name, tuple(ports), text)
