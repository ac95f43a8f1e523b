"""A deck of another hand, or a vendor's subcircuit: its text, checked card by card.

A line of the file ends at a line feed (or carriage return and line feed) and nowhere else, and a
logical line has only the characters of `ALLOWED`: no other separator, quote or backslash reaches
ngspice, which reads a line after any newline as a command. Comments are cut off, continuations
joined, and all is in lower case. Lengths are counted before any regular expression reads a line.

No line of the file reaches ngspice as it is. Cards of parts and of values stay, one line each;
analyses, outputs and options are left out, and so is everything between ``.control`` and ``.endc``.
``.include`` and ``.lib`` are followed inside the deck's folder only. Any other card is refused.
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from taction.netlist_gen.deck.expressions import LONGEST, OWN, number
from taction.netlist_gen.deck.flat_cards import ACCEPTED, spelt_card
from taction.netlist_gen.deck.foreign_cards import (
    LIBRARY,
    MISSING,
    MOST_CARDS,
    Card,
    blocks_of,
    called,
    check_expanded,
    check_functions,
    ngspice_cards,
    plain_name,
    plain_words,
    spelt,
)
from taction.spice_models.imported import DEVICE, Subcircuit
from taction.system.errors import Complaint, InputError, first_ones
from taction.system.foreign_files import UnusableFileError, read_bounded

LARGEST = 8_000_000  # bytes of a netlist with the files that it includes
MOST_LINES = 100_000  # of all these files
MOST_FILES = 500  # that a netlist includes, each as often as it is read
DEEPEST_FILES = 10  # within one another
ALLOWED = re.compile(r"[a-z0-9_ .,+\-*/(){}=:^<>!?&|#]*")
CODE_MODEL = (
    "a code model of ngspice (A) is not accepted: some start programs; a B source with"
    " V={...} does what gain, summer, mult, divide, limit, pwl (as table) and spice2poly (as E with"
    " POLY) do, a switch S with a .model sw what aswitch and pswitch do"
)
_ENDS = re.compile(r"^(\.ends\b[^*]*)\*.*")  # of joined files: a comment without its own line
_COMMENT = re.compile(r";|//|(?:^|(?<=\s))\$")
BLOCKS = {".control": ".endc", ".aliases": ".endaliases"}  # begin and end of what is left out
FILES = (".include", ".inc", ".lib")
_LEFT = """
    .title .options .option .opt .temp .tran .ac .op .dc .noise .tf .sens .pz .pss .sp .disto
    .four .fourier
    .print .plot .probe .save .meas .measure .width .step .backanno .ic .nodeset .csparam
"""
LEFT = tuple(_LEFT.split())
"""Cards that say what to simulate and to show, and nothing about the parts."""
DEFINED = (*LEFT, ".subckt", ".model")
AFTER_END = (
    "stands after the .end of line {}: ngspice reads on there, other simulators do not; expected"
    " .end as the last line (subcircuits and models may follow)"
)
_FILE = re.compile(
    r"\.(?:include|inc|lib)\s+(?:\"([^\"]*)\"|'([^']*)'|(\S+))(?:\s+([^\s\\/]+))?", re.I
)
_SPACED = re.compile(r"\.(?:include|inc|lib)\s+(?=\S)()()([^\"';]*[\\/][^\"';\\/]*)()", re.I)
_UNUSUAL = tuple('=[]?()&%$"!:,')  # a line that begins so is a comment of ngspice
_STRANGE = re.compile(r"[@\[\]\"'%\\~`]")  # such as in .save @v1[i]
_SAME_NODE = re.compile(r"(?<![\w$])(?:\$n_|n__)(?=\w)")
SAME_NODE = "$N_ of PSpice is read as N__, and here are nodes of both names; expected one of them"
_QUOTED = re.compile(r"'([^']*)'")
STEP = re.compile(r"^\.step (?:(?:lin|dec|oct) )?param (?:list )?([a-z_]\w*) (?:list )?(\S+)")
ASKED = (
    *(".ac", ".noise", ".meas", ".measure", ".pz", ".sens", ".dc"),
    *(".tf", ".disto", ".four", ".fourier", ".sp", ".pss"),
)
ANSWERED = (
    "does not run; found are poles, stability, the step response (--check settling=1ms), noise over"
    " all frequencies (--check noise=1mV), voltages at rest (--expect), over values by --over"
)
KEPT = (
    *(".subckt", ".ends", ".model", ".param", ".func", ".global"),
    *(".if", ".elseif", ".else", ".endif"),
)
LETTERS = "rclkviefghxbdqjmsw"  # devices that may stand in the text: no A, which may start programs
NOT_LINEAR = re.compile(r"[dqjmswb]|[efgh].*(?:\bvalue\b|\bvol\b|\bcur\b|\{v)")
_DIGITS = re.compile(r"(?:(?<=^\.model )\S+|(?<=[ =(])[-+]?[\d.]+(?:e[-+]?\d+)?[a-z]*(?=[ )]|$))")
_SET = re.compile(r"\b([a-z_][a-z0-9_]*) ?=(?!=)")
REFUSED = (  # what no card may hold, and the reason, with what was found
    (
        re.compile(r"^\.model \S+ (numd2?|nbjt2?|numos)\b"),
        "{} is a device of CIDER, which computes it from its mesh; expected a model that has"
        " parameters, such as d, npn or nmos",
    ),
    (
        re.compile(r"(?<![\w.])((?:[a-z]+_)?file(?:name)?|simulation|(?:sim|lib)_args) ?="),
        "{}= names a file or a program, which no card may; expected values",
    ),
    (
        re.compile(r"^[eg]\S* \S+ \S+ (chebyshev)\b"),
        "{} of PSpice is not read; expected E or G with LAPLACE {{V(a,b)}} {{F(s)}}",
    ),
    (
        re.compile(r"\b(pwl) ?\(? ?file\b"),
        "{} from a file is not read; expected its pairs of time and value",
    ),
    (
        re.compile(
            r"^(?:[begrcl][^={]*|\.func [^()]*\((?![^()]*\btime\b)[^{=]*)[={].*\b(time)\b(?! ?=)"
        ),
        "{} in an expression is a source over time, which has no small signal; expected a source"
        " V or I with pulse, pwl, sin or exp",
    ),
)
_NODE = re.compile(r"\b[vi] ?\([^()=]*\)")  # may have the name of anything


@dataclass(frozen=True, slots=True)
class ForeignDeck:
    """A checked deck."""

    file: Path  # where it stands
    cards: tuple[Card, ...]  # of parts and values, as ngspice reads them
    left: tuple[Card, ...] = ()  # cards that are left out: analyses, outputs, options
    remarks: tuple[str, ...] = ()  # what a reader of the deck should know: commands that do not run

    @property
    def lines(self) -> tuple[str, ...]:
        """The text of the cards."""
        return tuple(card.text for card in self.cards)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the ``.param`` cards outside of subcircuits."""
        own = (card.text for card in blocks_of(self.cards).cards if card.word == ".param")
        found = (re.findall(_SET, text) for text in own if text != MISSING["pi"])
        return tuple(dict.fromkeys(itertools.chain.from_iterable(found)))

    @property
    def with_first_steps(self) -> ForeignDeck:
        """The deck whose ``.step`` parameters without a ``.param`` have their first value."""
        made = dict[str, Card]()
        for card in self.left:
            match = STEP.match(card.text)
            if match and match[1] not in (*self.parameters, *made):
                made[match[1]] = card.with_text(f".param {match[1]} = {match[2]}")
        return replace(self, cards=(*self.cards, *made.values()))

    @property
    def is_plain(self) -> bool:
        """Whether no card may be other than linear."""
        return not any(map(NOT_LINEAR.match, self.lines))


def read_deck(file: str | Path) -> ForeignDeck:
    """Read a deck and check every card; nothing in it runs.

    InputError: a file cannot be read, or a card is not accepted, with its line.
    """
    path = Path(file)
    if path.suffix.lower() == ".asc":
        text = "a schematic of LTspice is no deck; expected its netlist: View, SPICE Netlist"
        raise InputError(path, Complaint("file", repr(path.name), text))
    reading = _DeckReading(path)
    cards = reading.file(path)
    deck, top = reading.checked(cards), blocks_of(cards)
    if not any(card.text[0].isalpha() for card in top.cards):
        text = "has no part outside of subcircuits; expected 'R1 in out 10k' or 'X1 in out NAME'"
        raise InputError(path, Complaint("deck", "", text))
    check_expanded(top)
    return deck


def vendor_subcircuit(file: str | Path, name: str) -> Subcircuit:
    """Return a subcircuit of a vendor's file as text for ngspice in PSpice's ways, all checked.

    Those that it calls, and models, parameters and functions outside of subcircuits stay; all else
    is left out. InputError: there is none of this name, or a card of it is not accepted.
    """
    path = Path(file)
    reading, own = _DeckReading(path), name.lower()
    top = blocks_of(reading.file(path))
    if own not in top.inner:
        known = ", ".join(sorted(top.inner)[:10]) or "none"
        text = f"the file has no subcircuit {name!r}; it has {known}"
        raise InputError(path, Complaint("netlist", "", text))
    wanted = [own]
    for each in wanted:  # which grows
        inner = dict.fromkeys(called(card.text) for card in top.inner[each].whole)
        wanted += [one for one in inner if one in top.inner and one not in wanted]
    check_expanded(replace(top, cards=[top.inner[own].cards[0].with_text(f"x {own}")]))
    kept = [card for card in top.cards if card.word in (".model", ".param", ".func")]
    kept += [card for each in wanted for card in top.inner[each].whole]
    lines, own = reading.checked(kept).lines, plain_name(own)
    head = next(line for line in lines if line.split()[:2] == [".subckt", own])
    return Subcircuit(own, tuple(plain_words(head)[1:]), lines)


def flat_subcircuit(cards: Iterable[str], nodes: Sequence[str], name: str) -> Subcircuit:
    """Return the subcircuit of a bench, its ports at `nodes`, from the cards of its listing."""

    def plain(match: re.Match[str]) -> str:
        """Return a number in plain digits, as in all of a deck; a name as it is.

        ngspice reads 200.0e-6 with another rounding, which an offset of microvolts shows.
        """
        with suppress(ValueError):
            return repr(number(match[0])) if set(match[0]) & set(".e") else match[0]
        return match[0]

    own = [spelt_card(card) for card in cards]
    own = [card if card[0] in "dqjmsw" else _DIGITS.sub(plain, card) for card in own]
    own = [c for c in own if c.startswith(".model ") or f".{DEVICE}." in c.split(maxsplit=1)[0]]
    return _subcircuit(f"m_{re.sub(r'[^a-z0-9]', '_', name.lower())}", nodes, own)


def stored_subcircuit(lines: Sequence[str], name: str, prefix: str) -> Subcircuit:
    """Return the flat subcircuit of a file of ours, checked; its name gets a `prefix`."""
    cards, remarks = logical_lines("\n".join(lines))
    words = [card.text.split() for card in (*cards[:1], *cards[-1:])]
    if not words or words[0][:2] != [".subckt", name] or words[-1][0] != ".ends":
        raise Card(1, "", "netlist").refused(f"expected a whole subcircuit {name!r}")
    if remarks:
        raise cards[0].refused(remarks[0])
    cards[-1].limited(len(cards), "cards", MOST_CARDS)
    for card in cards[1:-1]:
        if card.word != ".model" and card.text[0] not in LETTERS.replace("x", ""):
            raise card.refused(f"the card {card.word!r} is not accepted; expected flat cards")
        _screen(card)
    return _subcircuit(f"{prefix}_{name}", words[0][2:], (card.text for card in cards[1:-1]))


def _subcircuit(name: str, ports: Sequence[str], cards: Iterable[str]) -> Subcircuit:
    text = (f".subckt {name} {' '.join(ports)}", *cards, f".ends {name}")
    return Subcircuit(name, tuple(ports), text)


@dataclass(slots=True)
class _DeckReading:
    """A deck and its files, read in place."""

    deck: Path
    found: list[Card] = field(default_factory=list)  # as they stand in the files
    remarks: list[str] = field(default_factory=list)
    open: list[tuple[Path, str]] = field(default_factory=list)  # files and sections, being read
    known: set[tuple[Path, str]] = field(default_factory=set)  # files and sections that were read
    written: set[str] = field(default_factory=set)  # how nodes begin that are read as n__
    depth: int = 0  # of subcircuits
    files: int = -1  # that are included
    lines: int = 0  # of all files
    bytes: int = 0

    def file(self, path: Path, caller: Card | None = None, section: str = "") -> list[Card]:
        """Read the deck, or the file or the section of a library that a card names."""
        real, text = _real(path), self._text(path)
        text = _section(path, text, section) if section else text
        self.written |= set(_SAME_NODE.findall(text.lower()))
        if len(self.written) > 1:
            raise Card(1, "", path).refused(SAME_NODE)
        cards, remarks = logical_lines(text, path, title=caller is None)
        self.lines += text.count("\n") + 1
        self.files += 1
        self.remarks += remarks
        if caller is not None:
            if (real, section) in self.open:
                raise caller.refused("files within one another: this one is being read")
            caller.limited(len(self.open), "files within one another", DEEPEST_FILES)
            caller.limited(self.files, "files that are included", MOST_FILES)
            caller.limited(self.lines, "lines of the deck with its files", MOST_LINES)
            caller.limited(self.bytes, "bytes of the deck with its files", LARGEST)
        self.open.append((real, section))
        end = 0  # the line where the file says that it ends
        for card in cards:
            if card.word == ".end":
                end = end or card.number
            elif end and not self.depth and card.word not in DEFINED:
                raise card.refused(AFTER_END.format(end))
            elif card.word in FILES and (named := file_of(card.text)):
                self._include(card, path, *named)
            else:
                self.depth += (card.word == ".subckt") - (card.word == ".ends")
                self.found.append(card)
                card.limited(len(self.found), "cards", MOST_CARDS)
        self.open.pop()
        return self.found

    def checked(self, found: Iterable[Card]) -> ForeignDeck:
        """Return the deck of some cards, each checked and in plain words."""
        left, cards = list[Card](), list[Card]()
        for card in found:
            if card.word not in LEFT:
                _screen(card)
            (left if card.word in LEFT else cards).append(card)
        check_functions(cards)
        made, said = ngspice_cards(cards)
        said = [*dict.fromkeys((*self.remarks, *said))]
        return ForeignDeck(self.deck, tuple(made), tuple(left), tuple(said))

    def _text(self, path: Path) -> str:
        """Return the text of a file: UTF-8, UTF-16 as LTspice writes, or Latin-1; u for micro."""
        try:
            content = read_bounded(path, LARGEST)
        except UnusableFileError as error:
            raise InputError(path, Complaint("file", repr(path.name), str(error))) from None
        self.bytes += len(content)
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            return spelt(content.decode("utf-16", "replace"))
        try:
            return spelt(content.decode("utf-8-sig"))
        except UnicodeDecodeError:
            return spelt(content.decode("latin-1"))

    def _include(self, card: Card, origin: Path, name: str, section: str) -> None:
        """Read the file that a card names, if it is inside the deck's folder."""
        if not name.isprintable():
            raise card.refused("expected the name of a file, without control characters")
        folder, last = _real(self.deck).parent, name.rpartition("/")[2]
        target = _in_any_case(_real(origin).parent / name)
        inside = target.is_relative_to(folder) and _is_file(target)
        if not inside and _is_file(own := _in_any_case(folder / last)):
            target = own
            self.remarks.append(f"{name}: {last} in the deck's folder is read in its place")
        elif not _is_file(target) and LIBRARY.fullmatch(last):
            self.remarks.append(f"{last}: a library of LTspice or PSpice, which is not read")
            return
        if not target.is_relative_to(folder):
            raise card.refused(f"{name!r} is outside the deck's folder and not read; copy it there")
        if not _is_file(target):
            raise card.refused(f"the deck's folder has no file {name!r} ({folder.name}/)")
        if self.depth == 0 and (target, section) in self.known:
            self.remarks.append(f"{name}: included again, and read once")
            return
        self.known |= {(target, section)} if self.depth == 0 else set()
        self.file(target, card, section)


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
    inside, left = "", False
    for place, each in enumerate(raw, 1):
        Card(place, "", file).limited(len(each), "characters in a line", LONGEST)
        # 0x1A ends a file of DOS; joined files have it between them.
        line = each.strip("\x1a").rstrip("\r").replace("\t", " ").strip(" ")
        word = line.split(" ", maxsplit=1)[0].lower()
        if inside or word in BLOCKS:
            commands += (inside or BLOCKS[word]) == ".endc"
            inside = "" if word == inside else inside or BLOCKS[word]
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
        line = _ENDS.sub(r"\1", _QUOTED.sub(_braced, line).lower()).replace("$n_", "n__")
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
        lines = first_ones([*map(str, unusual)], 1)
        why = "begins with no letter, so that it is a comment, as in ngspice"
        remarks.insert(0, f"{name}: line {lines}: {why}")
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


def _screen(card: Card) -> None:
    """Refuse a card that is not accepted."""
    word, text = card.word, card.text
    if word[1:].startswith(OWN):
        raise card.refused(f"names that begin with {word[0]}{OWN} are taken by taction")
    if word.startswith(".") and word not in KEPT:
        accepted = " ".join((*KEPT, *FILES, *LEFT))
        raise card.refused(f"the card {word!r} is not accepted; accepted: {accepted}")
    if word[0] not in f".{LETTERS}":
        what = CODE_MODEL if word[0] == "a" else f"a device {word[0].upper()!r} is not accepted"
        raise card.refused(f"{what}; {ACCEPTED}")
    for pattern, reason in REFUSED:
        if match := pattern.search(_NODE.sub("0", text)):
            raise card.refused(reason.format(match[1]))


def _real(path: Path) -> Path:
    """Return a path with links followed; of links that loop some path."""
    return Path(os.path.realpath(path))


def _in_any_case(path: Path) -> Path:
    """Return the file of a path, or one whose name has other letters in capitals, as on Windows."""
    with suppress(OSError):
        names = [] if _is_file(path) else sorted(os.listdir(path.parent))  # noqa: PTH208 - as `_is_file`
        alike = (each for each in names if each.lower() == path.name.lower())
        path = path.parent / next(alike, path.name)
    return _real(path)


def _is_file(path: Path) -> bool:
    """Whether there is a file; there is none with a name that the system does not take."""
    return os.path.isfile(path)  # noqa: PTH113 - `Path.is_file` raises for a name of 300 letters


def _section(path: Path, text: str, section: str) -> str:
    """Return one section of a library, with empty lines for the others."""
    name = re.escape(section)
    found = re.search(rf"(?ims)^\s*\.lib\s+{name}\s*?$(.*?)(?=^\s*\.endl\b|\Z)", text)
    if not found:
        text = "the library has no such section ('.lib NAME' to '.endl')"
        raise InputError(path, Complaint(".lib", repr(section), text))
    return "\n" * text.count("\n", 0, found.start(1)) + found[1]
