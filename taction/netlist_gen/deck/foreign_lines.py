"""The lines of a foreign netlist, and how much of one is read.

A line of the file ends at a line feed (or carriage return and line feed) and nowhere else, and a
logical line has only the characters of `ALLOWED`: no other separator, quote or backslash reaches
ngspice, which reads a line after any newline as a command. Comments are cut off, continuations
joined, and all is in lower case. Lengths are counted before any regular expression reads a line.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from taction.system.errors import Complaint, InputError

LARGEST = 8_000_000  # bytes of a netlist with the files that it includes
MOST_LINES = 100_000  # of all these files
MOST_FILES = 500  # that a netlist includes, each as often as it is read
DEEPEST_FILES = 10  # within one another
LONGEST = 20_000  # characters of a line, with its continuations, and of an expression written anew
MOST_CARDS = 20_000  # of the files, and after every subcircuit is put in the place of its calls
MOST_LEVELS = 30  # of subcircuits within one another
MOST_PARTS = 3000  # R C L K V I E F G H B after that, without those within op-amps
MOST_COUPLINGS = 200  # K among them
MOST_WRITTEN = 300_000  # characters of .func and what calls them, with each in its place
ALLOWED = re.compile(r"[a-z0-9_ .,+\-*/(){}=:^<>!?&|#]*")
WHOLE = "expected '.subckt NAME ports', its cards, and '.ends NAME'"
_ENDS = re.compile(r"\.ends\*.*")  # of joined files: a comment without a line of its own
_COMMENT = re.compile(r";|//|(?:^|(?<=\s))\$")


@dataclass(frozen=True, slots=True)
class Card:
    """A logical line of a netlist.

    Attributes
    ----------
    number : int
        The line of the file where it begins, from 1.
    text : str
        In lower case.
    file : path
        The file.
    """

    number: int
    text: str
    file: str | Path = "netlist"

    @property
    def word(self) -> str:
        """Its first word."""
        return self.text.split(maxsplit=1)[0]

    def with_text(self, text: str) -> Card:
        """Return another card in its place."""
        return Card(self.number, text, self.file)

    def refused(self, reason: str) -> InputError:
        """Return the error for this card: why it is not accepted, or what is."""
        shown = repr(self.text[:80]) if self.text else ""
        return InputError(self.file, Complaint(f"line {self.number}", shown, reason))


def beyond(count: int, what: str, most: int) -> str:
    """Return the reason for a refusal, such as ``"9 cards; at most 8 are read"``."""
    return f"{count:,} {what}; at most {most:,} are read"


def physical_lines(content: bytes | str, file: str | Path = "netlist") -> list[str]:
    """Return the lines of a file, or of its text; refuse too many of them, and a long one."""
    lines = (content if isinstance(content, str) else content.decode("latin-1")).split("\n")
    if len(lines) > MOST_LINES:
        raise Card(MOST_LINES + 1, "", file).refused(beyond(len(lines), "lines", MOST_LINES))
    for place, line in enumerate(lines, 1):
        if len(line) > LONGEST:
            reason = beyond(len(line), "characters in a line", LONGEST)
            raise Card(place, "", file).refused(reason)
    return lines


def logical_lines(content: bytes | str | Sequence[str], file: str | Path = "netlist") -> list[Card]:
    r"""Return the logical lines of a file, of its text, or of its lines, without empty ones.

    Refuse a character that is not accepted outside of comments, and what is too long.

    Examples
    --------
    >>> logical_lines(b"* title\nR1 a b 1K ; load\n+ tc1=0\n")
    [Card(number=2, text='r1 a b 1k tc1=0', file='netlist')]
    """
    found, length = list[tuple[int, list[str]]](), 0
    raw = physical_lines(content, file) if isinstance(content, str | bytes) else content
    for place, each in enumerate(raw, 1):
        # 0x1A ends a file of DOS; joined files have it between them.
        line = each.strip("\x1a").rstrip("\r").replace("\t", " ").strip(" ").lower()
        if line.startswith("*"):
            continue
        line = _ENDS.sub(".ends", line)
        if comment := _COMMENT.search(line):
            line = line[: comment.start()]
        if wrong := ALLOWED.sub("", line, count=1):
            raise Card(place, "", file).refused(f"the character {wrong[0]!r} is not accepted")
        line = " ".join(line.split())
        if line.startswith("+"):
            if not found:
                raise Card(place, "", file).refused("a continuation of no line")
            found[-1][1].append(line[1:].strip())
            length += 1 + len(found[-1][1][-1])
        elif line:
            found.append((place, [line]))
            length = len(line)
        if length > LONGEST:
            text = beyond(length, "characters in a line with its continuations", LONGEST)
            raise Card(found[-1][0], "", file).refused(text)
    return [Card(begin, " ".join(parts), file) for begin, parts in found]


def subcircuits(
    cards: Iterable[Card], *, whole: bool = False
) -> tuple[dict[str, list[Card]], list[Card]]:
    """Return the cards of each subcircuit, its ``.subckt`` first, and those outside of all.

    With `whole` the text of each outermost one, with its ``.ends`` and those within it.
    """
    blocks, top, inside = dict[str, list[Card]](), list[Card](), list[list[Card]]()
    for card in cards:
        if card.word == ".subckt" and card.text != ".subckt":
            inside.append([card])
        elif card.word == ".subckt" or (card.word == ".ends" and not inside):
            raise card.refused(WHOLE)
        elif card.word == ".ends":
            block = [*inside.pop(), *([card] if whole else [])]
            if whole and inside:
                inside[-1] += block
                continue
            first = blocks.setdefault(block[0].text.split()[1], block)
            if [each.text for each in first] != [each.text for each in block]:
                raise block[0].refused("a second subcircuit of this name, which differs")
        else:
            (inside[-1] if inside else top).append(card)
    if inside:
        raise inside[0][0].refused(WHOLE)
    return blocks, top


def called(text: str) -> str:
    """Return the subcircuit that a card X calls; empty where it names none."""
    words = [w for w in re.sub(r" ?= ?", "=", text).split()[1:] if "=" not in w and w != "params:"]
    return words[-1] if words else ""


def check_expanded(
    blocks: Mapping[str, Sequence[Card]], top: Sequence[Card], opamps: Container[str] = ()
) -> list[str]:
    """Refuse a netlist that would be too large with every subcircuit in the place of its calls."""
    sizes: dict[str, _Size] = {}
    within, waiting = list[str](), _calls(top, blocks)
    while waiting:
        name, card = waiting.pop()
        if card is None:  # all that it calls is done
            sizes[name] = _size(blocks[name], sizes, name in opamps)
            within.remove(name)
        elif name in within:
            raise card.refused("a subcircuit that calls itself")
        elif name not in sizes:
            within.append(name)
            waiting += [(name, None), *_calls(blocks[name], blocks)]
    _size(top, sizes, False)
    return list(sizes)


class _Size(NamedTuple):
    """What a subcircuit holds with all that it calls."""

    levels: int = 0
    devices: int = 0
    parts: int = 0
    couplings: int = 0


LIMITS = _Size(MOST_LEVELS, MOST_CARDS, MOST_PARTS, MOST_COUPLINGS)
COUNTED = (
    "levels of subcircuits within one another",
    "devices with all subcircuits expanded",
    "parts with all subcircuits expanded",
    "couplings K",
)


def _calls(
    cards: Sequence[Card], blocks: Mapping[str, Sequence[Card]]
) -> list[tuple[str, Card | None]]:
    return [
        (name, card)
        for card in cards
        if card.text[0] == "x" and (name := called(card.text)) in blocks
    ]


def _size(cards: Sequence[Card], sizes: Mapping[str, _Size], replaced: bool) -> _Size:
    """Return the size of some cards; refuse the first one that passes a limit."""
    total = _Size()
    for card in cards:
        own = _Size(0, 1, not replaced, card.text[0] == "k" and not replaced)
        inner = sizes.get(called(card.text)) if card.text[0] == "x" else None
        if inner is not None:
            parts = (0, 0) if replaced else inner[2:]
            own = _Size(inner.levels + 1, inner.devices, *parts)
        elif card.text[0] == ".":
            continue
        levels = max(total.levels, own.levels)
        total = _Size(levels, *(a + b for a, b in zip(total[1:], own[1:], strict=True)))
        for count, what, most in zip(total, COUNTED, LIMITS, strict=True):
            if count > most:
                raise card.refused(beyond(count, what, most))
    return total
