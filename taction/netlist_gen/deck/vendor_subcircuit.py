"""The text of a vendor's subcircuit: as the bench reads it, flat, and from a file of ours again.

ngspice expands the bench; what is kept are the flat cards of its listing, in ngspice's own words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from taction.netlist_gen.deck.elements import spelt_card
from taction.netlist_gen.deck.foreign_deck import LETTERS, forbidden, read_library
from taction.netlist_gen.deck.foreign_lines import MOST_CARDS, Card, beyond, logical_lines
from taction.netlist_gen.deck.macromodels import check_size, ready_lines
from taction.spice_models.foreign_expressions import number
from taction.spice_models.imported import DEVICE, Subcircuit

_NUMBER = re.compile(r"(?:(?<=^\.model )\S+|(?<=[ =(])[-+]?[\d.]+(?:e[-+]?\d+)?[a-z]*(?=[ )]|$))")


def vendor_subcircuit(file: str | Path, name: str) -> Subcircuit:
    """Return a subcircuit of a vendor's file as text for ngspice in PSpice's ways."""
    deck, own = read_library(file, name), name.lower()
    check_size(deck, own)
    (head,) = [line for line in deck.lines if line.split()[:2] == [".subckt", own]]
    words = re.sub(r" ?= ?", "=", head).split()[2:]
    ports = tuple(word for word in words if "=" not in word and word != "params:")
    return Subcircuit(own, ports, tuple(ready_lines(deck)))


def flat_subcircuit(cards: Iterable[str], nodes: Sequence[str], name: str) -> Subcircuit:
    """Return the subcircuit of a bench, its ports at `nodes`, from the cards of its listing."""
    own = [spelt_card(card) for card in cards]
    own = [card if card[0] in "dqjmsw" else _NUMBER.sub(_plain, card) for card in own]
    own = [c for c in own if c.startswith(".model ") or f".{DEVICE}." in c.split(maxsplit=1)[0]]
    made = f"m_{re.sub(r'[^a-z0-9]', '_', name.lower())}"
    return Subcircuit(
        made, tuple(nodes), (f".subckt {made} {' '.join(nodes)}", *own, f".ends {made}")
    )


def _plain(match: re.Match[str]) -> str:
    """Return a number in plain digits; a name as it is."""
    try:
        return repr(number(match[0])) if set(match[0]) & set(".e") else match[0]
    except ValueError:
        return match[0]


def stored_subcircuit(lines: Sequence[str], name: str, prefix: str) -> Subcircuit:
    """Return the subcircuit of a file of ours, flat, with every card checked again.

    Its name gets a `prefix`.
    """
    found = logical_lines("\n".join(lines))
    cards = found.cards
    words = [card.text.split() for card in (*cards[:1], *cards[-1:])]
    if not words or words[0][:2] != [".subckt", name] or words[-1][0] != ".ends":
        raise Card(1, "", "netlist").refused(f"expected a whole subcircuit {name!r}")
    if found.remarks:
        raise cards[0].refused(found.remarks[0])
    if len(cards) > MOST_CARDS:
        raise cards[-1].refused(beyond(len(cards), "cards", MOST_CARDS))
    for card in cards[1:-1]:
        if card.word != ".model" and card.text[0] not in LETTERS.replace("x", ""):
            raise card.refused(f"the card {card.word!r} is not accepted; expected flat cards")
        if reason := forbidden(card.text):
            raise card.refused(reason)
    made, ports = f"{prefix}_{name}", words[0][2:]
    inner = (card.text for card in cards[1:-1])
    text = (f".subckt {made} {' '.join(ports)}", *inner, f".ends {made}")
    return Subcircuit(made, tuple(ports), text)
