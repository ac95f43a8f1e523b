"""A vendor's subcircuit from a foreign netlist: checked against a list, and written anew.

Nothing of the file reaches ngspice as it is: every card that the subcircuit needs is taken apart,
checked and written from its parts. All other cards of the file are checked by their kind only.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from taction.spice_models.foreign_devices import (
    Names,
    assignments,
    device,
    model_card,
    split_fields,
)
from taction.spice_models.foreign_expressions import NAME, SUBCIRCUIT
from taction.spice_models.foreign_lines import (
    LONGEST,
    Line,
    RefusedError,
    beyond,
    check_expanded,
    logical_lines,
)

CARDS = (".subckt", ".ends", ".model", ".param", ".end")
_BARE = re.compile(
    r"(\b[a-z_]\w* ?= ?)(?!\{|[+-]?[\d.]+(?:e[+-]?\d+)?[a-z]*(?: |$))"
    r"([^ =].*?)(?= [a-z_]\w* ?=(?!=)|$)"
)  # an expression without braces, as a .param may have it
MOST_CARDS = 5000  # of all cards of a subcircuit and those that it calls


@dataclass(frozen=True, slots=True)
class Subcircuit:
    """A checked subcircuit: its ports, and its text with those that it calls, outermost last."""

    name: str
    ports: tuple[str, ...]
    lines: tuple[str, ...]


@dataclass(slots=True)
class _NetlistBlock:
    """A subcircuit: its ``.subckt`` card, and those up to ``.ends``."""

    head: Line
    cards: list[Line] = field(default_factory=list)


def read_subcircuit(content: bytes, name: str, prefix: str) -> Subcircuit:
    """Return the subcircuit `name` of a netlist, its name and those that it calls with a `prefix`.

    Raises
    ------
    RefusedError
        A card is not accepted, or the file has no such subcircuit; the text has the line.
    """
    whole, blocks = _blocks(logical_lines(content))
    wanted = name.lower()
    if wanted not in blocks:
        known = ", ".join(sorted(blocks)[:10]) or "none"
        raise RefusedError(1, f"the file has no subcircuit {name!r}; it has {known}")
    order = _called(wanted, blocks)
    new = {old: f"{prefix}_{re.sub(r'[^a-z0-9]', '_', old)}" for old in order}
    if len(set(new.values())) < len(order):
        new = {old: f"{new[old]}_{k}" for k, old in enumerate(order)}
    lines: list[str] = []
    for old in order:
        lines += _write(blocks[old], whole, new, new[old])
    if longest := [line for line in lines if len(line) > LONGEST]:
        text = beyond(len(longest[0]), "characters in a card that is written anew", LONGEST)
        raise RefusedError(blocks[wanted].head.number, text, longest[0])
    if len(lines) > MOST_CARDS:
        raise blocks[wanted].head.refused(beyond(len(lines), "cards", MOST_CARDS))
    return Subcircuit(new[wanted], _ports(blocks[wanted]), tuple(lines))


def _blocks(lines: Iterable[Line]) -> tuple[list[Line], dict[str, _NetlistBlock]]:
    """Sort the cards into the top level and the subcircuits."""
    whole, blocks, inside = list[Line](), dict[str, _NetlistBlock](), None
    for line in lines:
        card = line.text.split()[0]
        if card.startswith(".") and card not in CARDS:
            raise line.refused(f"the card {card!r} is not accepted; accepted: {', '.join(CARDS)}")
        if card == ".subckt":
            words = line.text.split()
            if inside is not None or len(words) < 3 or not SUBCIRCUIT.fullmatch(words[1]):
                raise line.refused("a subcircuit within another, or without name and ports")
            if words[1] in blocks:
                raise line.refused(f"a second subcircuit {words[1]!r}")
            inside = blocks[words[1]] = _NetlistBlock(line)
        elif card == ".ends":
            if inside is None:
                raise line.refused("no subcircuit is open")
            inside = None
        elif card == ".end":
            break
        else:
            (whole if inside is None else inside.cards).append(line)
    if inside is not None:
        raise inside.head.refused("this subcircuit has no .ends")
    return whole, blocks


def _called(name: str, blocks: dict[str, _NetlistBlock]) -> list[str]:
    """Return a subcircuit and those that it calls, the innermost first."""
    first = Line(blocks[name].head.number, f"x {name}")
    return check_expanded({each: block.cards for each, block in blocks.items()}, [first], (name,))


def _head(block: _NetlistBlock) -> tuple[tuple[str, ...], list[str], Line]:
    """Return the ports of a subcircuit, its parameters, and its line."""
    try:
        fields = [f for f in split_fields(block.head.text)[2:] if f != "params:"]
    except ValueError as error:
        raise block.head.refused(str(error)) from None
    ports = tuple(f for f in fields if "=" not in f)
    if not all(map(NAME.fullmatch, ports)) or len(set(ports)) < len(ports) or "0" in ports:
        raise block.head.refused("the ports must be different names, without ground")
    return ports, [f for f in fields if "=" in f], block.head


def _ports(block: _NetlistBlock) -> tuple[str, ...]:
    return _head(block)[0]


def _write(block: _NetlistBlock, whole: list[Line], new: dict[str, str], name: str) -> list[str]:
    """Write a subcircuit; models and parameters of the top level become its own."""
    ports, given, head = _head(block)
    own = [line for line in block.cards if line.text.startswith(".model ")]
    models = {line.text.split()[1]: line for line in (*whole, *own) if _is(line, ".model")}
    parameters: list[tuple[Line, list[str]]] = []
    for line in (*whole, *block.cards):
        if _is(line, ".param"):
            try:
                fields = split_fields(_BARE.sub(r"\1{\2}", line.text.removeprefix(".param ")))
            except ValueError as error:
                raise line.refused(str(error)) from None
            parameters.append((line, fields))
    # A parameter may stand before those that it needs: ngspice puts them in order.
    keys = {text.partition("=")[0].strip() for _, fields in parameters for text in fields}
    names = Names(keys | {text.partition("=")[0].strip() for text in given}, models, new)
    written: list[str] = []
    for line, fields in parameters:
        try:
            written.append(".param " + " ".join(assignments(fields, names)))
        except ValueError as error:
            raise line.refused(str(error)) from None
    devices = [line for line in block.cards if not line.text.startswith(".")]
    written += [card for line in models.values() for card in model_card(line, names)]
    places: dict[str, Line] = {}
    for line in devices:
        card = device(line, names)
        if places.setdefault(card.split()[0], line) is not line:
            raise line.refused("a second device of this name")
        written.append(card)
    try:
        defaults = assignments(given, names)
    except ValueError as error:
        raise head.refused(str(error)) from None
    return [" ".join((".subckt", name, *ports, *defaults)), *written, f".ends {name}"]


def _is(line: Line, card: str) -> bool:
    return line.text.startswith(f"{card} ")
