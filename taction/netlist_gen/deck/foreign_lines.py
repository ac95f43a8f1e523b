"""The lines of a foreign netlist, its numbers and functions, and how much of it is read.

A line of the file ends at a line feed (or carriage return and line feed) and nowhere else, and a
logical line has only the characters of `ALLOWED`: no other separator, quote or backslash reaches
ngspice, which reads a line after any newline as a command. Comments are cut off, continuations
joined, and all is in lower case. Lengths are counted before any regular expression reads a line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from taction.system.errors import Complaint, InputError

SUFFIXES = {
    "meg": 1e6, "mil": 25.4e-6, "t": 1e12, "g": 1e9, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
    "p": 1e-12, "f": 1e-15,
}  # fmt: skip
_NUMBER = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)([a-z]*)")


def number(text: str) -> float:
    """Return a SPICE number: ``M`` is milli, ``MEG`` mega, further letters are a unit."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a number")
    scale = next((by for suffix, by in SUFFIXES.items() if match[2].startswith(suffix)), 1.0)
    value = float(match[1]) * scale
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


LARGEST = 8_000_000  # bytes of a netlist with the files that it includes
MOST_LINES = 100_000  # of all these files
MOST_FILES = 500  # that a netlist includes, each as often as it is read
DEEPEST_FILES = 10  # within one another
LONGEST = 20_000  # characters of a line, with its continuations, and of an expression written anew
MOST_CARDS = 20_000  # of the files, and after every subcircuit is put in the place of its calls
MOST_LEVELS = 30  # of subcircuits within one another
MOST_COUPLINGS = 200  # that one card K stands for
ALLOWED = re.compile(r"[a-z0-9_ .,+\-*/(){}=:^<>!?&|#]*")
CODE_MODEL = (
    "a code model of ngspice (A) is not accepted: some start programs; a B source with"
    " V={...} does what gain, summer, mult, divide, limit, pwl (as table) and spice2poly (as E with"
    " POLY) do, a switch S with a .model sw what aswitch and pswitch do"
)
LEVELS = "levels of subcircuits within one another"
WHOLE = "expected '.subckt NAME ports', its cards, and '.ends NAME'"
_ENDS = re.compile(r"\.ends\*.*")  # of joined files: a comment without a line of its own
_COMMENT = re.compile(r";|//|(?:^|(?<=\s))\$")
FILES = (".include", ".inc", ".lib")
_LEFT = """
    .title .options .option .opt .temp .tran .ac .op .dc .noise .tf .sens .pz .pss .sp .disto
    .four .fourier
    .print .plot .probe .save .meas .measure .width .step .backanno .ic .nodeset .csparam
"""
LEFT = tuple(_LEFT.split())
"""Cards that say what to simulate and to show, and nothing about the parts."""
_FILE = re.compile(
    r"\.(?:include|inc|lib)\s+(?:\"([^\"]*)\"|'([^']*)'|(\S+))(?:\s+([^\s\\/]+))?", re.I
)
_SPACED = re.compile(
    r"\.(?:include|inc|lib)\s+(?=\S)()()([^\"';]*[\\/][^\"';\\/]*)()", re.I
)  # with blanks
_UNUSUAL = tuple('=[]?()&%$"!:,')  # a line that begins so is a comment of ngspice
_STRANGE = re.compile(r"[@\[\]\"'%\\~`]")  # such as in .save @v1[i]
_QUOTED = re.compile(r"'([^']*)'")


@dataclass(frozen=True, slots=True)
class Card:
    """A logical line of a netlist."""

    number: int  # the line of the file where it begins, from 1
    text: str  # in lower case, if it names no file
    file: str | Path = "netlist"

    @property
    def word(self) -> str:
        """Its first word."""
        return self.text.split(maxsplit=1)[0].lower()

    def with_text(self, text: str) -> Card:
        """Return another card in its place."""
        return replace(self, text=text)

    def refused(self, reason: str) -> InputError:
        """Return the error for this card: why it is not accepted, or what is."""
        shown = repr(self.text[:80]) if self.text else ""
        return InputError(self.file, Complaint(f"line {self.number}", shown, reason))

    def limited(self, count: int, what: str, most: int) -> None:
        """Refuse this card where something is counted too often."""
        if count > most:
            raise self.refused(beyond(count, what, most))


def beyond(count: int, what: str, most: int) -> str:
    """Return the reason for a refusal, such as ``"9 cards; at most 8 are read"``."""
    return f"{count:,} {what}; at most {most:,} are read"


def logical_lines(
    text: str, file: str | Path = "netlist", *, title: bool = False
) -> tuple[list[Card], list[str]]:
    """Return the logical lines of a file's text, and what is said of those that were left out.

    A card that names a file has its text as it stands, any other one is in lower case. The first
    line may be a `title`.
    """
    raw = text.split("\n")
    Card(MOST_LINES + 1, "", file).limited(len(raw), "lines", MOST_LINES)
    if title and not raw[0].lstrip().startswith((".", "*")):
        raw[0] = ""  # whatever it says
    found, commands, unusual = list[tuple[int, list[str]]](), 0, list[int]()
    inside = left = False
    for place, each in enumerate(raw, 1):
        Card(place, "", file).limited(len(each), "characters in a line", LONGEST)
        # 0x1A ends a file of DOS; joined files have it between them.
        line = each.strip("\x1a").rstrip("\r").replace("\t", " ").strip(" ")
        word = line.split(" ", maxsplit=1)[0].lower()
        if inside or word == ".control":
            inside = word != ".endc"
            commands += 1
            continue
        if line.startswith("*"):
            continue
        left = word in LEFT or (left and word.startswith("+"))
        if word in FILES and file_of(line):
            found.append((place, [line]))
            continue
        if left:
            line = _STRANGE.sub(" ", line)
        elif line.startswith(_UNUSUAL):
            unusual.append(place)
            continue
        line = _ENDS.sub(".ends", _QUOTED.sub(_braced, line).lower())
        if comment := _COMMENT.search(line):
            line = line[: comment.start()]
        if wrong := ALLOWED.sub("", line, count=1):
            code_model = f"; {CODE_MODEL}" if line.startswith("a") else ""
            reason = f"the character {wrong[0]!r} is not accepted{code_model}"
            raise Card(place, "", file).refused(reason)
        line = " ".join(line.split())
        if line.startswith("+"):
            if not found:
                raise Card(place, "", file).refused("a continuation of no line")
            found[-1][1].append(line[1:].strip())
        elif line:
            found.append((place, [line]))
    cards, name = [Card(begin, " ".join(parts), file) for begin, parts in found], Path(file).name
    for card in cards:
        what = "characters in a line with its continuations"
        card.with_text("").limited(len(card.text), what, LONGEST)
    remarks = [f"{name}: {commands} lines of commands (.control) do not run"] * bool(commands)
    if unusual:
        more = f" and {len(unusual) - 1} more" if len(unusual) > 1 else ""
        why = "begins with no letter, so that it is a comment, as in ngspice"
        remarks.insert(0, f"{name}: line {unusual[0]}{more}: {why}")
    return cards, remarks


def _braced(match: re.Match[str]) -> str:
    """Return an expression in quotes in braces, with parentheses for those in it."""
    return "{" + match[1].replace("{", "(").replace("}", ")") + "}"


def file_of(line: str) -> tuple[str, str] | None:
    """Return the name of the file in a card, and the section of a library; None without one."""
    if match := _FILE.fullmatch(line) or _SPACED.fullmatch(line):
        name = next(filter(None, match.groups()[:3]), "")
        return name.replace("\\", "/"), (match[4] or "").lower()
    return None


@dataclass(slots=True, eq=False)
class Block:
    """A subcircuit, or all of a deck: its cards, and the subcircuits that stand in it."""

    outer: Block | None = None
    cards: list[Card] = field(default_factory=list)  # its own, the ``.subckt`` first
    whole: list[Card] = field(default_factory=list)  # with the inner ones, and its ``.ends``
    inner: dict[str, Block] = field(default_factory=dict)

    def find(self, name: str) -> Block | None:
        """Return the subcircuit that a name means here: an inner one hides an outer one."""
        block: Block | None = self
        while block is not None and name not in block.inner:
            block = block.outer
        return block and block.inner[name]


def blocks_of(cards: Iterable[Card]) -> Block:
    """Return a deck as a block, its subcircuits within one another as they stand."""
    here, depth = Block(), 0
    for card in cards:
        depth += (card.word == ".subckt") - (card.word == ".ends")
        card.limited(depth, LEVELS, MOST_LEVELS)
        if card.word == ".subckt" and card.text != ".subckt":
            here = Block(here)
        elif card.word == ".subckt" or (card.word == ".ends" and here.outer is None):
            raise card.refused(WHOLE)
        here.whole.append(card)
        if card.word != ".ends" or here.outer is None:
            here.cards.append(card)
            continue
        done, here = here, here.outer
        here.whole += done.whole
        first = here.inner.setdefault(done.cards[0].text.split()[1], done)
        if [each.text for each in first.whole] != [each.text for each in done.whole]:
            raise done.cards[0].refused("a second subcircuit of this name, which differs")
    if here.outer is not None:
        raise here.cards[0].refused(WHOLE)
    return here


def plain_words(text: str) -> list[str]:
    """Return what follows the first word of a card, without values of parameters."""
    words = re.sub(r" ?= ?", "=", text).split()[1:]
    return [word for word in words if "=" not in word and word != "params:"]


def called(text: str) -> str:
    """Return the subcircuit that a card X calls; empty where it names none."""
    words = plain_words(text)
    return words[-1] if text[0] == "x" and words else ""


def check_expanded(
    top: Block,
    calls: Callable[[str], Sequence[str]] = lambda text: [called(text)],
    what: str = "subcircuit",
) -> None:
    """Refuse the card with which there are too many, each block in the place of its calls."""
    sizes = dict[Block, int]()

    def size(block: Block, callers: tuple[Block, ...]) -> int:
        total = len(block.cards)
        for card in block.cards:
            for inner in filter(None, map(block.find, calls(card.text))):
                if inner in callers:
                    raise card.refused(f"a {what} that calls itself")
                card.limited(len(callers) + 1, LEVELS.replace("subcircuit", what), MOST_LEVELS)
                if inner not in sizes:
                    sizes[inner] = size(inner, (*callers, inner))
                total += sizes[inner]
            card.limited(total, f"cards with every {what} expanded", MOST_CARDS)
        return total

    size(top, ())


_FUNC = re.compile(r"\.func ([a-z_]\w*) ?\([^()]*\) ?=? ?(.*)")
_WORD = re.compile(r"[a-z_]\w*")


def check_functions(cards: Iterable[Card]) -> None:
    """Refuse functions that call too many others; what their arguments add, ngspice refuses."""
    top = Block()
    for card in cards:
        if match := _FUNC.fullmatch(card.text):
            top.inner[match[1]] = Block(top, [card.with_text(match[2])])
        else:
            top.cards.append(card)
    if top.inner:
        check_expanded(top, _WORD.findall, "function")
