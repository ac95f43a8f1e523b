"""The parts of an emitted deck, read from its text alone; nothing of the package is used.

Only the cards that taction writes are known; any other card is an error. The constant currents of a
subcircuit have the kind "J", those of the board, the strain, the kind "I".
"""

from __future__ import annotations

import re
from dataclasses import dataclass

GROUND = "0"
TERMINALS = {"R": 2, "C": 2, "I": 2, "V": 2, "B": 2, "G": 4, "E": 4}
IGNORED = (".title", "*", ".options", ".save", ".tran", ".op", ".end", ".ic")
READ = re.compile(r"V\((\w+)\)")
OUTPUT = re.compile(r"u_(\d+) = (-?)v\((\w+)\)")


@dataclass(frozen=True)
class Part:
    """One element: its kind is the first letter of its card; a B card has a text as value."""

    kind: str
    nodes: tuple[str, ...]
    value: float | str


@dataclass(frozen=True)
class DeckText:
    """A flat deck; `outputs` are pairs of a node and the sign of u at this node."""

    parts: tuple[Part, ...]
    outputs: tuple[tuple[str, int], ...]

    def of(self, *kinds: str) -> list[Part]:
        return [part for part in self.parts if part.kind in kinds]


def parse_deck(text: str) -> DeckText:
    """Expand the subcircuits of a deck; strain currents are taken at their final values."""
    cells: dict[str, tuple[list[str], list[str]]] = {}
    board: list[str] = []
    inside: list[str] | None = None
    saved: list[str] = []
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == ".subckt":
            inside = []
            cells[words[1]] = (words[2:], inside)
        elif words[0] == ".ends":
            inside = None
        elif words[0] == ".save":
            saved = [word[2:-1] for word in words[1:]]
        elif not line.startswith(IGNORED):
            (board if inside is None else inside).append(line)
    parts: list[Part] = []
    for line in board:
        words = line.split()
        if words[0].startswith("X"):
            ports, body = cells[words[-1]]
            names = dict(zip(ports, words[1:-1], strict=True))
            parts += [_part(card, names, f"{words[0]}.") for card in body]
        else:
            parts.append(_part(line, {}, ""))
    return DeckText(tuple(parts), _outputs(text, saved))


def _part(card: str, names: dict[str, str], prefix: str) -> Part:
    words = card.split()
    kind = words[0][0]
    count = TERMINALS[kind]

    def outside(node: str) -> str:
        return node if node == GROUND else names.get(node, prefix + node)

    nodes = tuple(outside(node) for node in words[1 : count + 1])
    if kind == "B":
        expression = re.split("[vV]=", card, maxsplit=1)[1]
        return Part(kind, nodes, READ.sub(lambda read: f"V({outside(read[1])})", expression))
    value = card.split(None, count + 1)[count + 1]
    if value.startswith("PWL("):
        value = value.rstrip(")").split()[-1]
    return Part("J" if kind == "I" and prefix else kind, nodes, float(value))


def _outputs(text: str, saved: list[str]) -> tuple[tuple[str, int], ...]:
    """Return the saved nodes with their signs; the header shows the sign of the first output."""
    shown = OUTPUT.search(text)
    assert shown is not None
    assert shown[3] == saved[0]
    sign = -1 if shown[2] else 1
    return tuple((node, sign) for node in saved)
