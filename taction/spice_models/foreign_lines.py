"""The lines of a foreign netlist, and how much of one is read.

A line of the file ends at a line feed (or carriage return and line feed) and nowhere else, and a
logical line has only the characters of `ALLOWED`: no other separator, quote or backslash reaches
ngspice, which reads a line after any newline as a command. Comments are cut off, continuations
joined, and all is in lower case. Lengths are counted before any regular expression reads a line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

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
_ENDS = re.compile(r"\.ends\*.*")  # of joined files: a comment without a line of its own
_COMMENT = re.compile(r";|//|(?:^|(?<=\s))\$")


class RefusedError(ValueError):
    """A line of a foreign netlist that is not accepted; the text has its number and the reason."""

    def __init__(self, number: int, reason: str, text: str = "") -> None:
        shown = f" {text[:60]!r}" if text else ""
        super().__init__(f"line {number}{shown}: {reason}")
        self.number = number


@dataclass(frozen=True, slots=True)
class Line:
    """A logical line: `number` is the line of the file where it begins, from 1."""

    number: int
    text: str

    def refused(self, reason: str) -> RefusedError:
        """Return the error for this line."""
        return RefusedError(self.number, reason, self.text)


def beyond(count: int, what: str, most: int) -> str:
    """Return the reason for a refusal: what was counted, and the limit.

    Examples
    --------
    >>> beyond(100_000, "characters in a line", 20_000)
    '100,000 characters in a line; at most 20,000 are read'
    """
    return f"{count:,} {what}; at most {most:,} are read"


def physical_lines(content: bytes | str) -> list[str]:
    """Return the lines of a file, or of its text.

    Raises
    ------
    RefusedError
        More lines than `MOST_LINES`, or a line over `LONGEST`.
    """
    lines = (content if isinstance(content, str) else content.decode("latin-1")).split("\n")
    if len(lines) > MOST_LINES:
        raise RefusedError(MOST_LINES + 1, beyond(len(lines), "lines", MOST_LINES))
    for place, line in enumerate(lines, 1):
        if len(line) > LONGEST:
            raise RefusedError(place, beyond(len(line), "characters in a line", LONGEST))
    return lines


def logical_lines(content: bytes | str | Sequence[str]) -> list[Line]:
    r"""Return the logical lines of a file, of its text, or of its lines, without empty ones.

    Raises
    ------
    RefusedError
        A character that is not accepted outside of comments, a continuation of nothing, or too
        long; see `physical_lines`.

    Examples
    --------
    >>> logical_lines(b"* title\nR1 a b 1K ; load\n+ tc1=0\n")
    [Line(number=2, text='r1 a b 1k tc1=0')]
    """
    found, length = list[tuple[int, list[str]]](), 0
    raw = physical_lines(content) if isinstance(content, str | bytes) else content
    for place, each in enumerate(raw, 1):
        # 0x1A ends a file of DOS; joined files have it between them.
        line = each.strip("\x1a").rstrip("\r").replace("\t", " ").strip(" ").lower()
        if line.startswith("*"):
            continue
        line = _ENDS.sub(".ends", line)
        if comment := _COMMENT.search(line):
            line = line[: comment.start()]
        if wrong := ALLOWED.sub("", line, count=1):
            raise RefusedError(place, f"the character {wrong[0]!r} is not accepted")
        line = " ".join(line.split())
        if line.startswith("+"):
            if not found:
                raise RefusedError(place, "a continuation of no line")
            found[-1][1].append(line[1:].strip())
            length += 1 + len(found[-1][1][-1])
        elif line:
            found.append((place, [line]))
            length = len(line)
        if length > LONGEST:
            text = beyond(length, "characters in a line with its continuations", LONGEST)
            raise RefusedError(found[-1][0], text)
    return [Line(begin, " ".join(parts)) for begin, parts in found]


class _Refusing(Protocol):
    """A card that knows its place in a file."""

    @property
    def text(self) -> str: ...

    def refused(self, reason: str, /) -> Exception: ...


Card = TypeVar("Card", bound=_Refusing)


def called(text: str) -> str:
    """Return the subcircuit that a card X calls; empty where it names none.

    Examples
    --------
    >>> called("x1 a b amp params: gain = 2"), called("x=1")
    ('amp', '')
    """
    words = [w for w in re.sub(r" ?= ?", "=", text).split()[1:] if "=" not in w and w != "params:"]
    return words[-1] if words else ""


@dataclass(slots=True)
class _Size:
    """What a subcircuit holds with all that it calls."""

    cards: int = 0
    parts: int = 0
    couplings: int = 0
    levels: int = 0


def check_expanded(
    blocks: Mapping[str, Sequence[Card]], top: Sequence[Card], opamps: Sequence[str] = ()
) -> list[str]:
    """Refuse a netlist that would be too large with every subcircuit in the place of its calls.

    Parameters
    ----------
    blocks : mapping of str to sequence of Card
        The cards of each subcircuit.
    top : sequence of Card
        The cards outside of subcircuits.
    opamps : sequence of str
        Subcircuits whose devices are no parts, because a model replaces them.

    Returns
    -------
    list of str
        The subcircuits that are called, each after those that it calls.

    Raises
    ------
    Exception
        The error of the card at which a limit is passed.
    """
    sizes: dict[str, _Size] = {}
    for name in _in_order(blocks, top):
        sizes[name] = _size(blocks[name], sizes, name in opamps)
    _size(top, sizes, False)
    return list(sizes)


def _in_order(blocks: Mapping[str, Sequence[Card]], top: Sequence[Card]) -> list[str]:
    """Return the subcircuits that are called, each after those that it calls."""
    order, within = dict[str, None](), list[str]()
    waiting: list[tuple[str, Card | None]] = [(called(c.text), c) for c in _calls(top, blocks)]
    while waiting:
        name, card = waiting.pop()
        if card is None:  # all that it calls is done
            order[within.pop()] = None
        elif name in within:
            raise card.refused("a subcircuit that calls itself")
        elif name not in order:
            within.append(name)
            waiting.append((name, None))
            waiting += [(called(c.text), c) for c in _calls(blocks[name], blocks)]
    return list(order)


def _calls(cards: Sequence[Card], blocks: Mapping[str, Sequence[Card]]) -> list[Card]:
    return [card for card in cards if card.text[0] == "x" and called(card.text) in blocks]


def _size(cards: Sequence[Card], sizes: Mapping[str, _Size], replaced: bool) -> _Size:
    """Return the size of some cards; the error of the first one that passes a limit."""
    total = _Size()
    for card in cards:
        inner = sizes.get(called(card.text)) if card.text[0] == "x" else None
        if inner is not None:
            total.cards += inner.cards
            total.parts += inner.parts
            total.couplings += inner.couplings
            total.levels = max(total.levels, inner.levels + 1)
        elif card.text[0] != ".":
            total.cards += 1
            total.parts += 1
            total.couplings += card.text[0] == "k"
        if total.levels > MOST_LEVELS:
            text = beyond(total.levels, "levels of subcircuits within one another", MOST_LEVELS)
            raise card.refused(text)
        if total.cards > MOST_CARDS:
            text = beyond(total.cards, "devices with all subcircuits expanded", MOST_CARDS)
            raise card.refused(text)
        if not replaced and total.parts > MOST_PARTS:
            text = "parts with all subcircuits expanded"
            raise card.refused(beyond(total.parts, text, MOST_PARTS))
        if not replaced and total.couplings > MOST_COUPLINGS:
            raise card.refused(beyond(total.couplings, "couplings K", MOST_COUPLINGS))
    if replaced:
        total.parts = total.couplings = 0
    return total
