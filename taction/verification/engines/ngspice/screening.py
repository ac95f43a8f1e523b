"""Check the text of a deck before ngspice reads it.

ngspice ends with exit status 0, without a message or with only a warning, for a missing field,
``1.2.3k``, a resistor of 0 Ω, an unknown option and a node whose voltage no element determines;
with KLU such a node makes *every* voltage of the circuit wrong. A deck can also run commands
(``.control``, ``*#``, ``*ng_script``). So only the cards, devices and options in the tables below
are accepted. The deck writer should never produce others; this second check reads text only and
shares no code with the writer.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from taction.netlist_gen.analysis import Analysis
from taction.system.errors import DidNotLoad, SingularCircuit


class ScreenedDeck(Protocol):
    """The properties of a deck (`taction.netlist_gen.deck.deck.ScreenedDeck`) that the runner uses.

    `files` maps names to the text of further files in the deck's folder; `saved` are the node
    names of the ``.save`` card; `analysis` is the requested analysis.
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
    .tran .op .noise .ac .save .options .ic .nodeset .temp .end
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
RUN_FILES = frozenset(
    ("deck.cir", "out.raw", "spinit", "command.txt", "stdout.txt", "stderr.txt", "listed.txt")
)
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?[a-z]*")
_CONTROL = "".join(map(chr, (*range(9), *range(11, 32), 127)))
_CONTINUATION = re.compile(r"\n[ \t]*\+")
_COMMANDS = ("*#", "*ng_script")


@dataclass(frozen=True, slots=True)
class _Device:
    """Least number of fields; terminals whose voltage the device sets (`held`) and does not set."""

    fields: int
    held: int
    free: int = 0


DEVICES = {
    "r": _Device(4, 2),
    "c": _Device(4, 2),
    "l": _Device(4, 2),
    "k": _Device(4, 0),  # names of coils, no nodes
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
PASSIVE, PASSIVE_FIELDS = "rcl", 4  # field 3 is a number; 0 Ω is refused


@dataclass(slots=True)
class _Scope:
    """Nodes of the top level, or of one subcircuit."""

    ports: tuple[str, ...] = ()
    held: set[str] = field(default_factory=lambda: {"0", "gnd"})
    free: dict[str, str] = field(default_factory=dict)  # node: line that names the node
    instances: dict[str, list[list[str]]] = field(default_factory=dict)  # subcircuit: nodes of each

    def add(self, line: str) -> None:
        """Check the line of a device, and add the nodes that it holds or touches."""
        parts, letter = line.split(), line[0]
        if letter in PASSIVE and len(parts) >= PASSIVE_FIELDS:  # nearly all lines of a board
            _check_value(line, parts[3])
            self.held.update(parts[1:3])
        elif letter == "x":
            words = [word for word in parts[1:] if "=" not in word and word != "params:"]
            *nodes, name = words or [""]
            self.instances.setdefault(name, []).append(nodes)
        else:
            self._add_source(line, parts)

    def _add_source(self, line: str, parts: list[str]) -> None:
        letter = line[0]
        if letter not in DEVICES:
            raise DidNotLoad(f"the device {parts[0]!r} is not accepted: {line!r}")
        device = DEVICES[letter]
        if len(parts) < device.fields:
            text = f"{line!r} has {len(parts)} fields; at least {device.fields} are needed"
            raise DidNotLoad(text)
        held, terminals = device.held, device.held + device.free
        if letter == "b" and parts[3].startswith("v"):
            held = 2
        if letter in "eg" and (len(parts) < 6 or "=" in "".join(parts[3:5]) or parts[3] == "poly"):
            terminals = 2  # a source given by an expression has only the terminals of its output
        for node in parts[1 + held : 1 + terminals]:
            self.free.setdefault(node, line)
        if letter == "g" and set(parts[1:3]) == set(parts[3:5]):
            held = 2  # controlled by its own voltage: a conductance
        self.held.update(parts[1 : 1 + held])


def screen(deck: ScreenedDeck) -> None:
    """Refuse a deck that ngspice would misread without a message, or that runs commands.

    Time is linear in the text, about 2 µs a line.

    Raises
    ------
    DidNotLoad
        A card, device, option, file name or number is not accepted; the line is quoted.
    SingularCircuit
        Only current sources and sensing terminals touch a node.
    """
    for name in deck.files:
        if not FILE_NAME.fullmatch(name) or name in RUN_FILES:
            raise DidNotLoad(f"include file name {name!r} is not accepted; use letters and digits")
    if len(set(map(str.lower, deck.saved))) != len(deck.saved) or not deck.saved:
        raise DidNotLoad(f"saved nodes must be distinct, and at least one: {deck.saved!r}")
    title, _, body = deck.text.partition("\n")
    reading = _ScreeningReading({name.lower(): text for name, text in deck.files.items()})
    # The first line is the title, unless ngspice reads it as a card or a script.
    reading.read(body if title[:1] not in "*." else deck.text)
    _refuse_floating(reading.scopes)


class _ScreeningReading:
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
            character = next(each for each in text if each in _CONTROL)
            raise DidNotLoad(f"the deck holds the control character {character!r}")
        for line in map(str.strip, _CONTINUATION.sub(" ", text.lower()).split("\n")):
            if line.startswith(_COMMANDS):
                raise DidNotLoad(f"a deck may not run commands: {line!r}")
            if line.startswith("."):
                self._card(line, line.split())
            elif line and line[0] != "*":
                self.scopes[self._within[-1]].add(line)

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


def _check_value(line: str, value: str) -> None:
    if value[0] not in "+-.0123456789":
        return  # an expression or a parameter, which ngspice checks itself
    number = NUMBER.fullmatch(value)
    if number is None:
        raise DidNotLoad(f"{value!r} is not a number: {line!r}")
    if line[0] == "r" and float(number[1]) == 0.0:
        raise DidNotLoad(f"a resistor of 0 Ω: {line!r}")


def _refuse_floating(scopes: dict[str, _Scope]) -> None:
    """Raise SingularCircuit for a node, at any level, whose voltage no element determines."""
    solved: dict[str, frozenset[int]] = {}

    def holds(name: str) -> frozenset[int]:
        """Return the ports (by position) that subcircuit `name` holds."""
        if name not in solved:
            scope = scopes.get(name)
            if scope is None:
                raise DidNotLoad(f"subcircuit {name!r} is not in the deck")
            solved[name] = frozenset()  # valid while a subcircuit that calls itself is read
            check(scope)
            solved[name] = frozenset(i for i, p in enumerate(scope.ports) if p in scope.held)
        return solved[name]

    def check(scope: _Scope) -> None:
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

    check(scopes[""])


def _floating(node: str, line: str) -> SingularCircuit:
    return SingularCircuit(
        f"no element determines the voltage of node {node!r} (only current sources and sensing"
        f" inputs touch the node): {line!r}. Connect a resistor or a capacitor to the node"
    )
