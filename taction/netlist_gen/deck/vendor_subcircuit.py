"""The text of a vendor's subcircuit: as ngspice reads it, and flat.

ngspice expands the bench; what is kept are the flat cards of its listing, in ngspice's own words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from taction.netlist_gen.deck.elements import spelt_card
from taction.netlist_gen.deck.foreign_cards import plain_name
from taction.netlist_gen.deck.foreign_deck import LETTERS, forbidden, read_library
from taction.netlist_gen.deck.foreign_lines import MOST_CARDS, Card, logical_lines
from taction.spice_models.imported import DEVICE, Subcircuit


def vendor_subcircuit(file: str | Path, name: str) -> Subcircuit:
    """Return a subcircuit of a vendor's file as text for ngspice in PSpice's ways."""
    lines, own = read_library(file, name).lines, plain_name(name.lower())
    head = next(line for line in lines if line.split()[:2] == [".subckt", own])
    words = re.sub(r" ?= ?", "=", head).split()[2:]
    ports = tuple(word for word in words if "=" not in word and word != "params:")
    return Subcircuit(own, ports, lines)


def flat_subcircuit(cards: Iterable[str], nodes: Sequence[str], name: str) -> Subcircuit:
    """Return the subcircuit of a bench, its ports at `nodes`, from the cards of its listing."""
    own = [card for card in map(spelt_card, cards)
           if card.startswith(".model ") or f".{DEVICE}." in card.split(maxsplit=1)[0]]  # fmt: skip
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
