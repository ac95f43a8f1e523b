"""What decks of LTspice say and ngspice does not read: characters, op-amps, parasitics, numbers.

All is written anew as plain cards before a deck is checked, and what it stands for is said.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence

from taction.netlist_gen.deck.foreign_lines import MOST_COUPLINGS

SPELT = {
    "\N{MICRO SIGN}": "u",
    "\N{GREEK SMALL LETTER MU}": "u",
    "\N{OHM SIGN}": "ohm",
    "\N{GREEK CAPITAL LETTER OMEGA}": "ohm",
    "\N{NO-BREAK SPACE}": " ",
}
"""Characters of values, and what is read for them."""
SIGNS = "\N{SECTION SIGN}\N{DEGREE SIGN}"  # in names, beside letters of other alphabets
_FOREIGN = re.compile(r"[^\x00-\x7f]")
MISSING = {
    "pi": f".param pi={math.pi!r}",
    "mc": ".func mc(x,tol) {x}",
    "agauss": ".func agauss(x,tol,sigma) {x}",
    "gauss": ".func gauss(x,tol,sigma) {x}",
    "aunif": ".func aunif(x,tol) {x}",
    "unif": ".func unif(x,tol) {x}",
    "limit": ".func limit(x,a,b) {min(max(x,min(a,b)),max(a,b))}",
}
"""What another simulator defines, by its name; ngspice alone draws all but the first two.

A drawn value counts with its nominal one.
"""
DRAWN = ("mc", "agauss", "gauss", "aunif", "unif")
DRAWN_LIMIT = ".func limit(x,tol) {x}"  # that of ngspice: one of both ends
_TWO = re.compile(r"\blimit ?\([^(),]*,[^(),]*\)")
_LEVEL = "avol=1meg gbw=10meg slew=10meg ilimit=25m rail=0 vos=0 phimargin=45 en=0 enk=0 in=0 ink=0"
_FIVE = f"1 2 3 4 5 params: {_LEVEL} rin=500meg"
_STAGE = (
    "rin 1 2 {rin}",
    "eos p 0 1 0 1",
    "vos q p {vos}",
    "g1 0 x q 2 {avol*1u}",
    "r1 x 0 1meg",
    f"c1 x 0 {{avol/gbw*1u/{math.tau!r}}}",
)
_ONE_POLE = (*_STAGE, "e1 5 0 x 0 1")
_TWO_POLES = (
    *_STAGE,
    "g2 0 y x 0 1m",
    "r2 y 0 1k",
    f"c2 y 0 {{1m/({math.tau!r}*gbw*tan(phimargin*{math.pi!r}/180))}}",
    "e1 5 0 y 0 1",
)
OPAMPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "opamp": (
        "1 2 3 params: aol=100k gbw=10meg",
        ("g1 0 3 2 1 {aol}", "r3 3 0 1", f"c3 3 0 {{aol/gbw/{math.tau!r}}}"),
    ),
    **dict.fromkeys(("level.1", "level1", "level.2", "level2"), (_FIVE, _ONE_POLE)),
    **dict.fromkeys(("level.3a", "level3a"), (_FIVE, _TWO_POLES)),
}
"""Op-amps of LTspice by name: ports and parameters, and the linear cards that stand for them."""
LIBRARY = re.compile(r"(?:opamp|universalopamps?2?)\.sub|ltc\d*\.lib|standard\.\w+", re.I)
"""Files that LTspice reads from a folder of its own."""
SERIES = {"r": ("rser",), "c": ("rser", "lser"), "l": ("rser",), "v": ("rser",)}
PARALLEL = {"r": ("cpar",), "c": ("rpar", "cpar"), "l": ("rpar", "cpar"), "v": ("cpar",)}
"""Parasitic parts of resistors, capacitors, coils and sources: within the part, and across it."""
IDLE = {
    "r": ("tol", "pwr"),
    "c": ("v", "irms", "mfg", "pn", "type", "tol"),
    "l": ("ipk", "mfg", "pn", "type", "tol"),
}
"""What a catalogue says of a part, without effect."""
_GIVEN = re.compile(r"\s+([a-z]\w*)\s*=\s*(\{[^{}]*\}|\S+)")
_CATALOGUE = re.compile(r"\s(?:mfg|pn|type)=\"[^\"\n]*\"", re.I)
_MARKED = re.compile(r"(\d+)(meg|[tgkmunpfr])(\d+)(?:f|h|ohm)?")  # such as 2k2
_MARKED_PARAM = re.compile(r"= ?(\d+)(meg|[tgkmunpf])(\d+)(?= |$)")
_THERMAL = re.compile(
    r" (?:noiseless|tc ?= ?[^ ,{}]+(?: ?, ?[^ ,{}]+)?)(?= |$)"
)  # no effect at 27 degrees C, or on poles
_COMMA = re.compile(r"(\{[^{}]*\}|= ?[a-z_]\w* ?\([^()]*\))|,")  # those in expressions stay
_PORT = re.compile(r" portnum ?=? ?\d+(?: z0 ?=? ?(\S+))?(?: (?:pwr|freq|phase) ?=? ?\S+)*")
DROPPED = (
    ("r", re.compile(r" ac ?= ?(?:\{[^{}]*\}|\S+)"), "its AC value ac="),
    (".model", re.compile(r"\bt_abs ?= ?(?:\{[^{}]*\}|[^ ,()]+)"), "T_ABS"),
)
"""What is left out of cards with these beginnings, and its name."""


def spelt(text: str) -> str:
    """Return the text of a file with ASCII for the characters of values and of names.

    A sign or a letter of another alphabet becomes its code, so that no two names become one.
    Other characters stay, and are refused outside of comments.
    """
    return _FOREIGN.sub(_ascii, _CATALOGUE.sub("", text))


def _ascii(match: re.Match[str]) -> str:
    letter = match[0]
    if letter in SPELT:
        return SPELT[letter]
    return f"_{ord(letter):x}_" if letter in SIGNS or letter.isalpha() else letter


def plain_cards(text: str) -> Iterator[str]:
    """Yield plain cards for one in lower case: 2k2 in digits, parasitics as parts."""
    letter = text[0]
    if text.startswith(".param"):
        yield _MARKED_PARAM.sub(r"=\1.\3\2", text)
        return
    if text.startswith(".model"):
        yield " ".join(_COMMA.sub(lambda match: match[1] or " ", text).split())
        return
    if letter == "k" and len(words := text.split()) > 4:  # of several coils, each with each
        pairs = list(itertools.combinations(words[1:-1][:MOST_COUPLINGS], 2))
        if len(pairs) > MOST_COUPLINGS:
            raise ValueError(f"more than {MOST_COUPLINGS} couplings; expected several cards K")
        yield from (f"{words[0]}_{k} {a} {b} {words[-1]}" for k, (a, b) in enumerate(pairs, 1))
        return
    if letter in "rcl":
        text = _THERMAL.sub("", text)
    if letter == "v" and (match := _PORT.search(text)):
        text = f"{_PORT.sub('', text)} rser={match[1] or '50'}"
    if letter == "i":
        yield text.removesuffix(" load")
        return
    fields = dict(_GIVEN.findall(text)) if letter in "rclv" else {}
    inner = [key for key in SERIES.get(letter, ()) if _size(fields.get(key, "0"))]
    outer = [key for key in PARALLEL.get(letter, ()) if _size(fields.get(key, "0"))]
    own = {*SERIES.get(letter, ()), *PARALLEL.get(letter, ()), *IDLE.get(letter, ())}
    if fields:
        text = _GIVEN.sub(lambda match: "" if match[1] in own else match[0], text)
    words = text.split()
    if letter in "rcl" and len(words) > 3 and (match := _MARKED.fullmatch(words[3])):
        words[3] = f"{match[1]}.{match[3]}{match[2].removeprefix('r')}"
    if not (inner or outer) or len(words) < 4:
        yield " ".join(words) if letter in "rcl" else text
        return
    name, a, b = words[:3]
    nodes = [a, *(f"{a}_taction_{name}_{k}" for k in range(1, len(inner) + 1))]
    yield " ".join((name, nodes[-1], *words[2:]))
    for key, one, other in zip(inner, nodes, nodes[1:], strict=False):
        yield f"{key}_{name} {one} {other} {fields[key]}"
    for key in outer:
        yield f"{key}_{name} {a} {b} {fields[key]}"


def _size(text: str) -> float:
    """Return a plain number, and 1 for any other text: whether a part is there at all."""
    try:
        return float(text)
    except ValueError:
        return 1.0


def missing_cards(texts: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the cards that define what others use and do not define, and the drawn functions."""
    cards, drawn = list[str](), list[str]()
    for word, definition in MISSING.items():
        used = re.compile(rf"\b{word}\b" if word == "pi" else rf"\b{word} ?\(")
        using = [text for text in texts if word in text and used.search(text)]
        own = re.compile(rf"^\.func {word}\b|\b{word} ?=(?!=)")
        if using and not any(own.search(text) for text in using):
            two = word == "limit" and any(map(_TWO.search, using))
            cards.append(DRAWN_LIMIT if two else definition)
            drawn += [word] if two or word in DRAWN else []
    return cards, drawn


def opamp_cards(name: str) -> Iterator[str]:
    """Yield the linear cards of one of LTspice's op-amps."""
    head, cards = OPAMPS[name]
    yield f".subckt {plain_name(name)} {head}"
    yield from cards
    yield f".ends {plain_name(name)}"


def plain_name(name: str) -> str:
    """Return the name of an op-amp for ngspice, in which a dot would end it."""
    return f"ltspice_{name.replace('.', '_')}"
