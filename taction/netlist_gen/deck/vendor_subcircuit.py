"""The text of a vendor's subcircuit: as ngspice reads it, and flat.

ngspice expands the bench; what is kept are the flat cards of its listing, in ngspice's own words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from taction.netlist_gen.deck.elements import spelt_card
from taction.netlist_gen.deck.foreign_deck import LETTERS, forbidden, read_library
from taction.netlist_gen.deck.foreign_lines import MOST_CARDS, Card, called, logical_lines, number
from taction.spice_models.imported import DEVICE, Subcircuit

_NUMBER = re.compile(r"(?:(?<=^\.model )\S+|(?<=[ =(])[-+]?[\d.]+(?:e[-+]?\d+)?[a-z]*(?=[ )]|$))")


def vendor_subcircuit(file: str | Path, name: str) -> Subcircuit:
    """Return a subcircuit of a vendor's file as text for ngspice in PSpice's ways.

    Subcircuits get other names: ngspice does not find one whose name has a sign such as '/'.
    """
    deck, own = read_library(file, name), name.lower()
    heads = [line for line in deck.lines if line.startswith(".subckt ")]
    new = {head.split()[1]: f"m{k}" for k, head in enumerate(heads)}
    (head,) = [line for line in heads if line.split()[1] == own]
    words = re.sub(r" ?= ?", "=", head).split()[2:]
    ports = tuple(word for word in words if "=" not in word and word != "params:")
    lines = list[str]()
    for text in deck.lines:
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
    cards, remarks = logical_lines("\n".join(lines))
    words = [card.text.split() for card in (*cards[:1], *cards[-1:])]
    if not words or words[0][:2] != [".subckt", name] or words[-1][0] != ".ends":
        raise Card(1, "", "netlist").refused(f"expected a whole subcircuit {name!r}")
    if remarks:
        raise cards[0].refused(remarks[0])
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
