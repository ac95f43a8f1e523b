"""The text of a vendor's subcircuit: as the bench reads it, flat, and from a file of ours again.

ngspice expands the bench; what is kept are the flat cards of its listing, in ngspice's own words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from taction.netlist_gen.deck.elements import spelt_card
from taction.netlist_gen.deck.foreign_deck import LETTERS, forbidden, read_library
from taction.netlist_gen.deck.foreign_lines import (
    called,
    check_expanded,
    logical_lines,
    subcircuits,
)
from taction.netlist_gen.deck.macromodels import check_size, ready_lines
from taction.spice_models.foreign_expressions import number
from taction.spice_models.imported import DEVICE, Subcircuit

STORED = (".subckt", ".ends", ".model", ".param")
_NUMBER = re.compile(r"(?:(?<=^\.model )\S+|(?<=[ =(])[-+]?[\d.]+(?:e[-+]?\d+)?[a-z]*(?=[ )]|$))")


def vendor_subcircuit(file: str | Path, name: str) -> Subcircuit:
    """Return a subcircuit of a vendor's file as text for ngspice in PSpice's ways, last of all."""
    deck = read_library(file, name)
    check_size(deck, name.lower())
    heads = [line for line in deck.lines if line.startswith(".subckt ")]
    new = {head.split()[1]: f"m{k}" for k, head in enumerate(heads)}
    wanted = name.lower()
    (head,) = [each for each in heads if each.split()[1] == wanted]
    words = re.sub(r" ?= ?", "=", head).split()[2:]
    ports = tuple(word for word in words if "=" not in word and word != "params:")
    return Subcircuit(new[wanted], ports, tuple(_renamed(ready_lines(deck), new)))


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
    """Return the subcircuit of a file of ours, with every card checked again.

    Its name, and those of the subcircuits that it calls, get a `prefix`.
    """
    cards = logical_lines("\n".join(lines))
    for card in cards:
        if card.word not in STORED and card.text[0] not in LETTERS:
            accepted = " ".join(STORED)
            raise card.refused(f"the card {card.word!r} is not accepted; expected {accepted}")
        if reason := forbidden(card.text):
            raise card.refused(reason)
    blocks, top = subcircuits(cards)
    if top or name not in blocks:
        raise (top or cards)[0].refused(f"expected a whole subcircuit {name!r}")
    order = check_expanded(blocks, [blocks[name][0].with_text(f"x {name}")], within=False)
    new = {old: f"{prefix}_{old}" for old in order}
    written = (
        text for old in order for text in (*(card.text for card in blocks[old]), f".ends {old}")
    )
    ports = tuple(word for word in blocks[name][0].text.split()[2:] if "=" not in word)
    return Subcircuit(new[name], ports, tuple(_renamed(written, new)))


def _renamed(lines: Iterable[str], new: Mapping[str, str]) -> Iterable[str]:
    """Yield cards with other names of the subcircuits."""
    for text in lines:
        words = re.sub(r" ?= ?", "=", text).split()
        old = called(text) if text[0] == "x" else "".join(words[1:2])
        if old in new and (text[0] == "x" or words[0] in (".subckt", ".ends")):
            place = max(k for k, word in enumerate(words) if word == old) if text[0] == "x" else 1
            words[place] = new[old]
            yield " ".join(words)
        else:
            yield text
