"""What decks of LTspice say and ngspice does not read: characters, op-amps, parasitics, numbers.

All is written anew as plain cards before a deck is checked, and what it stands for is said.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

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
MISSING = {"pi": f".param pi={math.pi!r}", "mc": ".func mc(x,tol) {x}"}
"""What LTspice defines, by its name; a drawn value counts with its nominal one."""
_LEVEL = "avol=1meg gbw=10meg slew=10meg ilimit=25m rail=0 vos=0 phimargin=45 en=0 enk=0 in=0 ink=0"
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
    "level.1": (f"1 2 3 4 5 params: {_LEVEL} rin=500meg", _ONE_POLE),
    "level.2": (f"1 2 3 4 5 params: {_LEVEL} rin=500meg", _ONE_POLE),
    "level.3a": (f"1 2 3 4 5 params: {_LEVEL} rin=500meg", _TWO_POLES),
}
"""Op-amps of LTspice by name: ports and parameters, and the linear cards that stand for them."""
LIBRARY = re.compile(r"(?:opamp|universalopamps?2?)\.sub|ltc\d*\.lib|standard\.\w+", re.I)
"""Files that LTspice reads from a folder of its own."""
SERIES = {"c": ("rser", "lser"), "l": ("rser",), "v": ("rser",)}
PARALLEL = {"c": ("rpar", "cpar"), "l": ("rpar", "cpar"), "v": ("cpar",)}
"""Parasitic parts of a capacitor, a coil and a source: within the part, and across all of it."""
IDLE = {
    "r": ("tol", "pwr"),
    "c": ("v", "irms", "mfg", "pn", "type", "tol"),
    "l": ("ipk", "mfg", "pn", "type", "tol"),
}
"""What a catalogue says of a part, without effect."""
_GIVEN = re.compile(r"\s+([a-z]\w*)\s*=\s*(\{[^{}]*\}|\S+)")
_CATALOGUE = re.compile(r"\s(?:mfg|pn|type)=\"[^\"\n]*\"", re.I)
_MARKED = re.compile(r"(\d+)(meg|[tgkmunpf])(\d+)(?:f|h|ohm)?")  # such as 2k2
_MARKED_PARAM = re.compile(r"= ?(\d+)(meg|[tgkmunpf])(\d+)(?= |$)")


def spelt(text: str) -> str:
    """Return the text of a file with ASCII for the characters of values and of names.

    A sign or a letter of another alphabet becomes its code, so that no two names become one.
    Other characters stay, and are refused outside of comments.

    Examples
    --------
    >>> spelt("C1 a 0 4.7\N{MICRO SIGN}F")
    'C1 a 0 4.7uF'
    >>> spelt("X\N{SECTION SIGN}U1 in 0 out opamp")
    'X_a7_U1 in 0 out opamp'
    """
    return _FOREIGN.sub(_ascii, _CATALOGUE.sub("", text))


def _ascii(match: re.Match[str]) -> str:
    letter = match[0]
    if letter in SPELT:
        return SPELT[letter]
    return f"_{ord(letter):x}_" if letter in SIGNS or letter.isalpha() else letter


def plain_cards(text: str) -> Iterator[str]:
    """Yield plain cards for one in lower case: values such as 2k2 in digits, parasitics as parts.

    Examples
    --------
    >>> list(plain_cards("l1 a b 10u rser=0.1 cpar=5p"))
    ['l1 a_taction_l1_1 b 10u', 'rser_l1 a a_taction_l1_1 0.1', 'cpar_l1 a b 5p']
    >>> list(plain_cards("r1 a b 2k2 tol=1"))
    ['r1 a b 2.2k']
    """
    letter = text[0]
    if text.startswith(".param"):
        yield _MARKED_PARAM.sub(r"=\1.\3\2", text)
        return
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
        words[3] = f"{match[1]}.{match[3]}{match[2]}"
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


def opamp_cards(name: str) -> Iterator[str]:
    """Yield the linear cards of one of LTspice's op-amps.

    Examples
    --------
    >>> list(opamp_cards("opamp"))[1:3]
    ['g1 0 3 2 1 {aol}', 'r3 3 0 1']
    """
    head, cards = OPAMPS[name]
    yield f".subckt {plain_name(name)} {head}"
    yield from cards
    yield f".ends {plain_name(name)}"


def plain_name(name: str) -> str:
    """Return the name of an op-amp for ngspice, in which a dot would end it."""
    return f"ltspice_{name.replace('.', '_')}"
