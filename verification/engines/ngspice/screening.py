"""What is checked in a deck's text before ngspice sees it.

ngspice answers with exit status 0, in silence or with a mere warning, to a missing field,
``1.2.3k``, a resistor of 0 Ω, an unknown option and a node that nothing holds; with KLU the last
one makes *every* voltage of the circuit wrong. A deck can also run commands (``.control``,
``*#``, ``*ng_script``). So only cards, devices and options in the tables below are sent. The
deck writer should never produce anything else; this is the second lock on the door, and it reads
text only, sharing nothing with the writer.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from netlist_gen.analysis import Analysis
from spice_models.errors import DidNotLoad, SingularCircuit


class Deck(Protocol):
    """What the runner needs of a deck (`netlist_gen.deck.deck.Deck`): its text, what to expect.

    `files` are further files by bare name, written beside the deck; `saved` are the node names
    of its ``.save`` card; `analysis` is the one it asks for.
    """

    @property
    def text(self) -> str: ...  # noqa: D102
    @property
    def files(self) -> Mapping[str, str]: ...  # noqa: D102
    @property
    def saved(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def analysis(self) -> Analysis: ...  # noqa: D102


_CARDS = """
    .title .include .subckt .ends .model .param .func .global
    .tran .op .save .options .ic .nodeset .temp .end
"""
# No `interp` (it resamples on a coarse grid) and no `savecurrents` (twice the time).
_OPTIONS = """
    klu sparse noopiter noopac noinit acct noacct numdgt keepopinfo nodedamping
    method maxord xmu minbreak delmin temp tnom gminsteps srcsteps
    reltol abstol vntol chgtol trtol absdv reldv pivtol pivrel gmin gshunt rshunt cshunt
    itl1 itl2 itl3 itl4 itl5 itl6
"""
CARDS = frozenset(_CARDS.split())
OPTIONS = frozenset(_OPTIONS.split())
FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
RUN_FILES = frozenset(("deck.cir", "out.raw", "spinit", "command.txt", "stdout.txt", "stderr.txt"))
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?[a-z]*")
_CONTROL = "".join(map(chr, (*range(9), *range(11, 32), 127)))
_CONTINUATION = re.compile(r"\n[ \t]*\+")
_COMMAND = re.compile(r"\n[^\S\n]*(\*(?:#|ng_script).*)")
_PIECE = re.compile(r"\n[^\S\n]*(\S)[^\n]*(?:\n[^\S\n]*\1[^\n]*)*")  # lines of one letter


@dataclass(frozen=True, slots=True)
class _Device:
    """Terminals of a device by kind: `held` have a voltage set through it, `free` do not."""

    fields: int
    held: int
    free: int = 0


DEVICES = {
    "r": _Device(4, 2),
    "c": _Device(4, 2),
    "l": _Device(4, 2),
    "v": _Device(4, 2),
    "i": _Device(4, 0, 2),
    "e": _Device(4, 2, 2),
    "g": _Device(4, 0, 4),
    "f": _Device(5, 0, 2),
    "h": _Device(5, 2),
    "b": _Device(4, 0, 2),
    "d": _Device(4, 2),
    "q": _Device(5, 3),
    "j": _Device(5, 3),
    "m": _Device(6, 4),
    "s": _Device(6, 2, 2),
}
PASSIVE, PASSIVE_FIELDS = "rcl", 4  # field 3 is a value that must be a number; not 0 Ω


@dataclass(slots=True)
class _Scope:
    """Nodes of the top level or of one subcircuit, or of some of their lines."""

    ports: tuple[str, ...] = ()
    held: set[str] = field(default_factory=lambda: {"0", "gnd"})
    free: dict[str, str] = field(default_factory=dict)  # node to the line that names it
    instances: dict[str, list[list[str]]] = field(default_factory=dict)  # nodes, by subcircuit

    def add(self, lines: _Scope) -> None:
        """Add what further lines do."""
        self.held |= lines.held
        for node, line in lines.free.items():
            self.free.setdefault(node, line)
        for name, nodes in lines.instances.items():
            self.instances[name] = [*self.instances.get(name, ()), *nodes]


def screen(deck: Deck) -> None:
    """Refuse a deck that ngspice would misread, or obey, without a word.

    Time is linear in the text, about 0.5 µs a line; successive lines of one letter that stood in
    the last deck, too, are not read again.

    Raises
    ------
    DidNotLoad
        A card, device, option, file name or number that is not accepted; the line is quoted.
    SingularCircuit
        A node that only current sources and sensing terminals touch.
    """
    for name in deck.files:
        if not FILE_NAME.fullmatch(name) or name in RUN_FILES:
            raise DidNotLoad(f"include file name {name!r} is not accepted; use letters and digits")
    if len(set(map(str.lower, deck.saved))) != len(deck.saved) or not deck.saved:
        raise DidNotLoad(f"saved nodes must be distinct, and at least one: {deck.saved!r}")
    title, _, body = deck.text.partition("\n")
    reading = _Reading({name.lower(): text for name, text in deck.files.items()})
    # ngspice takes the first line for a title, unless it is one of these two.
    reading.read(body if title[:1] not in "*." else deck.text)
    _refuse_floating(reading.scopes)


class _Reading:
    """Reads a deck and the files it includes, in place, into `scopes`."""

    def __init__(self, files: Mapping[str, str]) -> None:
        self.scopes: dict[str, _Scope] = {"": _Scope()}
        self._files = files
        self._open: list[str] = []  # included files being read
        self._within: list[str] = [""]  # subcircuits being read

    def read(self, text: str) -> None:
        """Read every line of `text`."""
        content = text.encode(errors="surrogatepass")
        if len(content.translate(None, _CONTROL.encode())) < len(content):
            found = next(each for each in text if each in _CONTROL)
            raise DidNotLoad(f"the deck holds the control character {found!r}")
        lines = _CONTINUATION.sub(" ", text.lower())
        for piece in _PIECE.finditer("\n" + lines):
            if piece[1] == "*":
                if command := _COMMAND.search(piece[0]):
                    raise DidNotLoad(f"a deck may not run commands: {command[1].strip()!r}")
            elif piece[1] == ".":
                for line in map(str.strip, piece[0][1:].split("\n")):
                    self._card(line, line.split())
            else:
                self.scopes[self._within[-1]].add(_read_devices(piece[0]))

    def _card(self, line: str, parts: list[str]) -> None:
        card = parts[0]
        if card not in CARDS:
            raise DidNotLoad(f"the card {card!r} is not accepted: {line!r}")
        if card == ".include":
            self._include(line)
        elif card == ".options":
            _check_options(line, parts)
        elif card == ".subckt":
            ports = tuple(p for p in parts[2:] if "=" not in p and p != "params:")
            self._within.append(" ".join(parts[1:2]))
            self.scopes[self._within[-1]] = _Scope(ports=ports)
        elif card == ".ends" and len(self._within) > 1:
            self._within.pop()

    def _include(self, line: str) -> None:
        name = line.removeprefix(".include").strip().strip("\"'")
        if name not in self._files:
            raise DidNotLoad(f"{line!r} names no file of this deck; it has {sorted(self._files)}")
        if name in self._open:
            raise DidNotLoad(f"{line!r} includes a file within itself")
        self._open.append(name)
        self.read(self._files[name])
        self._open.pop()


def _check_options(line: str, parts: list[str]) -> None:
    for part in parts[1:]:
        option = part.partition("=")[0]
        if option not in OPTIONS:
            raise DidNotLoad(f"the option {option!r} is not accepted: {line!r}")


@functools.lru_cache(maxsize=32)  # a board of the usual op-amps has some 15 such pieces
def _read_devices(lines: str) -> _Scope:
    """Check the devices of a piece, and note the nodes that they hold or touch.

    Two decks of one board share nearly all pieces, hence the cache, whose entries nobody changes.
    """
    found, held, values = _Scope(), list[str](), set[str]()  # values that have been checked
    for line in map(str.strip, lines[1:].split("\n")):
        parts = line.split()
        letter = line[0]
        if letter in PASSIVE and len(parts) >= PASSIVE_FIELDS:  # nearly all lines of a board
            held += parts[1:3]
            if parts[3] not in values:
                _check_value(line, parts[3])
                values.add(parts[3])
        elif letter == "x":
            *nodes, name = _instance(line, parts)
            found.instances.setdefault(name, []).append(nodes)
        else:
            _read_source(line, parts, found)
    found.held.update(held)
    return found


def _instance(line: str, parts: list[str]) -> list[str]:
    """Return the nodes and, last, the name of the subcircuit that a line calls."""
    words = parts[1:]
    if "=" in line or "params:" in words:
        words = [word for word in words if "=" not in word and word != "params:"]
    return words or [""]


def _read_source(line: str, parts: list[str], found: _Scope) -> None:
    """Add the nodes of a device that is not passive."""
    letter = line[0]
    if letter not in DEVICES:
        raise DidNotLoad(f"the device {parts[0]!r} is not accepted: {line!r}")
    _check_length(line, parts, letter)
    device = DEVICES[letter]
    held = 2 if letter == "b" and parts[3].startswith("v") else device.held
    for node in parts[1 + held : 1 + _terminals(letter, parts, device)]:
        found.free.setdefault(node, line)
    if letter == "g" and set(parts[1:3]) == set(parts[3:5]):
        held = 2  # controlled by its own voltage: a conductance
    found.held.update(parts[1 : 1 + held])


def _check_length(line: str, parts: list[str], letter: str) -> None:
    wanted = DEVICES[letter].fields
    if len(parts) < wanted:
        raise DidNotLoad(f"{line!r} has {len(parts)} fields; at least {wanted} are needed")


def _terminals(letter: str, parts: list[str], device: _Device) -> int:
    """Return the number of terminals; a source given by an expression has only its output's two."""
    if letter in "eg" and (len(parts) < 6 or "=" in "".join(parts[3:5]) or parts[3] == "poly"):
        return 2
    return device.held + device.free


def _check_value(line: str, value: str) -> None:
    if value[0] not in "+-.0123456789":
        return  # an expression or a parameter; ngspice complains about a bad one
    found = NUMBER.fullmatch(value)
    if found is None:
        raise DidNotLoad(f"{value!r} is not a number: {line!r}")
    if line[0] == "r" and float(found[1]) == 0.0:
        raise DidNotLoad(f"a resistor of 0 Ω: {line!r}")


def _refuse_floating(scopes: dict[str, _Scope]) -> None:
    """Raise SingularCircuit for a node whose voltage nothing sets, at any level."""
    solved: dict[str, frozenset[int]] = {}

    def holds(name: str) -> frozenset[int]:
        """Return the ports (by position) that subcircuit `name` holds."""
        if name not in solved:
            scope = scopes.get(name)
            if scope is None:
                raise DidNotLoad(f"subcircuit {name!r} is not in the deck")
            solved[name] = frozenset()  # stands while a subcircuit that calls itself is read
            settle(scope)
            solved[name] = frozenset(i for i, p in enumerate(scope.ports) if p in scope.held)
        return solved[name]

    def settle(scope: _Scope) -> None:
        for subcircuit, instances in scope.instances.items():
            for i in holds(subcircuit):
                scope.held.update([nodes[i] for nodes in instances if i < len(nodes)])
        fixed = scope.held.union(scope.ports)
        for node, line in scope.free.items():
            if node not in fixed:
                raise _floating(node, line)
        for subcircuit, instances in scope.instances.items():
            for node in itertools.chain.from_iterable(instances):
                if node not in fixed:
                    raise _floating(node, f"x... {subcircuit}")

    settle(scopes[""])


def _floating(node: str, line: str) -> SingularCircuit:
    return SingularCircuit(
        f"nothing holds the voltage of node {node!r} (only current sources and sensing inputs touch"
        f" it): {line!r}. Give it a resistor or a capacitor"
    )
