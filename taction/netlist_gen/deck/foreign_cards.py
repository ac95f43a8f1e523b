"""Cards of a foreign netlist, its subcircuits, and what ngspice does not read, written anew for it.

LTspice's characters, op-amps, parasitics and numbers; PSpice's switches, its ground and its
temperature; POLY, tables and transfer functions. What a card stands for, or that something of it
does not count, is said.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from taction.netlist_gen.deck.expressions import (
    as_expression,
    beyond,
    number,
    source_cards,
    without_calls,
)
from taction.system.errors import Complaint, InputError

MOST_CARDS = 20_000  # of the files, and after every subcircuit is put in the place of its calls
MOST_LEVELS = 30  # of subcircuits within one another
MOST_COUPLINGS = 200  # that one card K stands for
LEVELS = "levels of subcircuits within one another"
WHOLE = "expected '.subckt NAME ports', its cards, and '.ends NAME'"
SPELT = str.maketrans(  # characters of values, and what is read for them
    {
        "\N{MICRO SIGN}": "u",
        "\N{GREEK SMALL LETTER MU}": "u",
        "\N{OHM SIGN}": "ohm",
        "\N{GREEK CAPITAL LETTER OMEGA}": "ohm",
        "\N{NO-BREAK SPACE}": " ",
    }
)
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
DRAWN_WORDS = "a drawn value counts with its nominal one; --tolerances draws"
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
OPAMP_WORDS = (
    "the linear part of LTspice's op-amp of this name, its gain, bandwidth and phase margin; its"
    " limits and its noise do not count"
)
UNKNOWN = (
    "the deck has no subcircuit {}; put the file with its .subckt into the folder and write"
    " '.include FILE'; known without one: {}"
)
LIBRARY = re.compile(r"(?:opamp|universalopamps?2?)\.sub|(?:ltc\d*|nom)\.lib|standard\.\w+", re.I)
"""Files that LTspice and PSpice read from a folder of their own."""
PARASITIC = {
    "r": (("rser",), ("cpar",)),
    "c": (("rser", "lser"), ("rpar", "cpar")),
    "l": (("rser",), ("rpar", "cpar")),
    "v": (("rser",), ("cpar",)),
}  # parts within resistors, capacitors, coils and sources, in series with them, and across them
IDLE = {"tol", "pwr", "v", "irms", "mfg", "pn", "type", "ipk"}
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
DROPPED = (  # what is left out of cards with these beginnings, and its name
    ("r", re.compile(r" ac ?= ?(?:\{[^{}]*\}|\S+)"), "its AC value ac="),
    (".model", re.compile(r"\bt_abs ?= ?(?:\{[^{}]*\}|[^ ,()]+)"), "T_ABS"),
)


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


@dataclass(slots=True, eq=False)
class Block:
    """A subcircuit, or all of a deck: its cards, and the subcircuits that stand in it."""

    outer: Block | None = None
    cards: list[Card] = field(default_factory=list)  # its own, the ``.subckt`` first
    whole: list[Card] = field(default_factory=list)  # with the inner ones, and its ``.ends``
    inner: dict[str, Block] = field(default_factory=dict)

    def find(self, name: str) -> Block | None:
        """Return the subcircuit that a name means here: an inner one hides an outer one."""
        found = self.inner.get(name)
        return found if found or self.outer is None else self.outer.find(name)


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


def spelt(text: str) -> str:
    """Return the text of a file with ASCII for the characters of values and of names.

    A sign or a letter of another alphabet becomes its code, so that no two names become one.
    Other characters stay, and are refused outside of comments.
    """

    def code(match: re.Match[str]) -> str:
        letter = match[0]
        return f"_{ord(letter):x}_" if letter in SIGNS or letter.isalpha() else letter

    return _FOREIGN.sub(code, _CATALOGUE.sub("", text).translate(SPELT))


def plain_cards(text: str) -> Iterator[str]:
    """Yield plain cards for one in lower case: 2k2 in digits, parasitics as parts."""
    letter, words = text[0], text.split()
    if words[0] == ".param":
        yield _MARKED_PARAM.sub(r"=\1.\3\2", text)
    elif words[0] == ".model":
        yield " ".join(_COMMA.sub(lambda match: match[1] or " ", text).split())
    elif letter == "k" and len(words) > 4:  # of several coils, each with each
        pairs = list(itertools.combinations(words[1:-1][:MOST_COUPLINGS], 2))
        if len(pairs) > MOST_COUPLINGS:
            raise ValueError(f"more than {MOST_COUPLINGS} couplings; expected several cards K")
        yield from (f"{words[0]}_{k} {a} {b} {words[-1]}" for k, (a, b) in enumerate(pairs, 1))
    elif letter in PARASITIC:
        yield from _with_parasitics(text)
    else:
        yield text.removesuffix(" load") if letter == "i" else text


def _with_parasitics(text: str) -> Iterator[str]:
    """Yield the cards of R, C, L or V with the parts that it has besides."""
    letter = text[0]
    if letter == "v" and (match := _PORT.search(text)):
        text = f"{_PORT.sub('', text)} rser={match[1] or '50'}"
    text = text if letter == "v" else _THERMAL.sub("", text)
    fields = dict(_GIVEN.findall(text))
    inner, outer = ([key for key in keys if fields.get(key, "0").strip("0.")]
                    for keys in PARASITIC[letter])  # fmt: skip
    idle = {*itertools.chain(*PARASITIC[letter]), *(IDLE if letter != "v" else ())}
    name, *words = _GIVEN.sub(lambda match: "" if match[1] in idle else match[0], text).split()
    if letter != "v" and len(words) > 2 and (match := _MARKED.fullmatch(words[2])):
        words[2] = f"{match[1]}.{match[3]}{match[2].removeprefix('r')}"
    if not (inner or outer) or len(words) < 3:
        yield " ".join((name, *words))
        return
    nodes = [words[0], *(f"{words[0]}_taction_{name}_{k + 1}" for k in range(len(inner)))]
    yield " ".join((name, nodes[-1], *words[1:]))
    places = [*itertools.pairwise(nodes), *([tuple(words[:2])] * len(outer))]
    for key, (a, b) in zip((*inner, *outer), places, strict=True):
        yield f"{key}_{name} {a} {b} {fields[key]}"


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


# Switches of PSpice; those with thresholds are ngspice's own.
_SMOOTH = re.compile(r"\.model (\S+) ([vi])switch\b(?!.*\b[vi][th] ?=)(.*)")
_FIELD = re.compile(r"(\w+) ?= ?(\{[^{}]*\}|[^\s(),]+)")
_RANGES = {  # of PSpice's switches, by what controls them, with its values
    "v": {"ron": "1", "roff": "1meg", "von": "1", "voff": "0"},
    "i": {"ron": "1", "roff": "1meg", "ion": "1m", "ioff": "0"},
}
_GROUND = re.compile(r"(?<=[\s(,])gnd(?=[\s),]|$)(?! ?=)")


def ngspice_cards(cards: Sequence[Card]) -> tuple[list[Card], list[str]]:
    """Return the cards as ngspice reads them, what they lack before them, and what is said."""
    lacking, drawn = missing_cards([card.text for card in cards])
    said = [f"{name}(): {DRAWN_WORDS}" for name in drawn]
    made, here, opamps = list[Card](), blocks_of(cards), dict[str, None]()
    for card in cards:
        text, named = card.text, called(card.text)
        if card.word == ".subckt":
            here = here.inner[named := text.split()[1]]
        elif card.word == ".ends" and here.outer is not None:
            here, text = here.outer, ".ends"
        if here.outer is not None and "gnd" not in here.cards[0].text.split():
            text = _GROUND.sub("0", text)  # there PSpice has it as another node
        for beginning, pattern, what in DROPPED:
            if text.startswith(beginning) and pattern.search(text):
                text = pattern.sub("", text)
                shown = text.split(maxsplit=2)[: 2 if card.word == ".model" else 1]
                said.append(f"{' '.join(shown)}: {what} does not count")
        if text[0] == "x" and here.find(named) is None:
            if named not in OPAMPS:
                raise card.refused(UNKNOWN.format(repr(named), ", ".join(OPAMPS)))
            opamps[named] = None
        if (plain := plain_name(named)) != named:
            before, _, after = f"{text} ".rpartition(f" {named} ")
            text = f"{before} {plain} {after}".strip()
        try:
            made += map(card.with_text, _written(text, here))
        except ValueError as error:
            raise card.refused(str(error)) from None
    for name in opamps:
        head, body = OPAMPS[name]
        lacking += [f".subckt {plain_name(name)} {head}", *body, ".ends"]
        said.append(f"{name}: {OPAMP_WORDS}")
    return [*(cards[0].with_text(each) for each in lacking), *made], said


def _written(text: str, here: Block) -> Iterator[str]:
    """Yield the cards for ngspice of one that stands in a block."""
    if "{" in text:  # ngspice lacks the temperature
        text = re.sub(r"\btemp(?:er)?\b(?! ?=)", "27", text)
    if _SMOOTH.match(text):
        return
    for plain in plain_cards(text):
        switch = _smooth_switch(plain, here) if plain[0] in "sw" else plain
        for each in source_cards(switch):
            yield without_calls(as_expression(each))


def plain_name(name: str) -> str:
    """Return the name of a subcircuit for ngspice, which does not find one with other signs."""
    return re.sub(r"\W", lambda match: f"_{ord(match[0]):x}_", name)


def _smooth_switch(text: str, here: Block | None) -> str:
    """Return PSpice's switch as a resistance that changes smoothly with what controls it."""
    name, *words = text.split()
    model = None
    while model is None and here is not None:
        every = (_SMOOTH.match(card.text) for card in here.cards)
        model, here = next((m for m in every if m and m[1] == words[-1]), None), here.outer
    if model is None or len(words) != {"s": 5, "w": 4}[text[0]]:
        return text
    kind, given = model[2], dict(_FIELD.findall(model[3]))
    if unknown := given.keys() - _RANGES[kind].keys():
        raise ValueError(f"{min(unknown)} of a {kind}switch is not accepted")
    every_value = (_RANGES[kind] | given).values()
    ron, roff, on, off = (each if each[0] == "{" else repr(number(each)) for each in every_value)
    if on == off or any(each.startswith("-") or each == "0.0" for each in (ron, roff)):
        raise ValueError(f"a {kind}switch needs resistances above 0, and two ends that differ")
    control = f"v({words[2]},{words[3]})" if kind == "v" else f"i({words[2]})"
    # ln R = ln sqrt(Ron Roff) + ln(Ron/Roff) (1.5 x - 2 x³), x from -1/2 to 1/2
    place = f"max(min(({control}-0.5*({on}+{off}))/({on}-{off}),0.5),-0.5)"
    power = f"0.5*log({ron}*{roff})+log({ron}/{roff})*{place}*(1.5-2.0*{place}*{place})"
    return f"b{name} {words[0]} {words[1]} i=v({words[0]},{words[1]})*exp(-({power}))"
