"""The operating point of a deck as it is, and what is not linear in it, each measured alone there.

ngspice finds a first point as it does by itself, then a tight one from there. The text of the
second run is kept: whoever asks ngspice about the point sends the same text, so that ngspice
repeats this point to the last bit. It has a source of current into every node for the witness.

Elements are measured on one bench, held at rest: each becomes its ``G + s C`` as linear parts with
constants that make it rest where it rests. A device is measured without its ohmic resistances,
which are parts of their own; that they are in series the witness sees. Voltages of a device count
from its last terminal, so that one between floating nodes stays floating.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.deck.expressions import number
from taction.netlist_gen.deck.flat_cards import (
    ABSENT,
    CardError,
    Element,
    Flat,
    Models,
    card_of,
    model_cards,
    read_cards,
    shown,
    sum_parts,
)
from taction.spice_models.branches import Branch
from taction.system.array_types import Complexes, Floats
from taction.system.errors import DidNotLoad, first_ones
from taction.verification.engines.ngspice.commands import RESULT, Answers, expand, run_commands
from taction.verification.engines.ngspice.process import find_simulator

MOST_NODES = 600  # of a deck: above it the engine needs the structure of a topology
MOST_PARTS = 3000  # R C L K E F G H that are not measured
TIGHT = "reltol=1e-9 abstol=1e-15 vntol=1e-12"
AT_ONCE = "optran 1 1 1 0 0 0"  # no transient to the operating point
AT_REST = ("save all", "op", f"write {RESULT}")
LONGER = "optran 0 0 0 10n 10u 0"  # its steps and its length, s
TRIED = (
    TIGHT,
    "reltol=1e-6 abstol=1e-13 vntol=1e-10",
    "reltol=1e-5 abstol=1e-13 vntol=1e-7",
    "reltol=1e-4 abstol=1e-12 vntol=1e-6",
    "reltol=1e-3",
    f"{TIGHT} klu pivrel=0.9",
)
"""Tolerances of ngspice in the order in which they are tried; in the end with its other solver."""
UNBIASED = 1e-6  # V: a range below is rounding
ELSEWHERE = 0.1  # of the range of all voltages: a point farther away is another one
OWN = "a transient"  # limits of a point that ngspice finds in no other way
TRIED_SECONDS = 4.0  # of one start
SECONDS = 60.0  # of small signals
PROBE = "taction_probe"
MODES = ("psa", "")  # PSpice's ways first; what they break is read in ngspice's own


@dataclass(frozen=True, slots=True, eq=False)
class DeckPoint:
    """Where a deck rests."""

    lines: tuple[str, ...]  # the deck's text, as ngspice reads it in `mode`
    cards: tuple[str, ...]  # flat ones
    weights: Mapping[str, float]  # current into each node, A for 1 V of the source `PROBE`
    options: str  # of the deck, such as gmin
    mode: str  # of ngspice: see `MODES`
    flat: Flat  # the cards, read
    volts: Mapping[str, float]  # by node, V; currents by ``name#branch``, A; what transistors say
    limits: str  # tolerances of ngspice with which it was found; `TIGHT` is nine digits
    text: tuple[str, ...] = ()  # with it, after `AT_ONCE`, ngspice finds the point again; or empty

    @property
    def starts(self) -> list[str]:
        """Cards that make ngspice start at this point."""
        return [f".nodeset v({node})={self.volts[node]!r}" for node in self.weights]

    def small_signals(
        self, driven: Sequence[Mapping[str, float]], sweeps: Sequence[str], option: str = ""
    ) -> tuple[list[dict[str, Complexes]], str]:
        """Return ngspice's ``.ac`` by vectors for all sets of sources and sweeps, or why not."""
        excited = [card.split()[0] for card in self.cards if card[0] in "vi" and " ac" in card]
        commands = [*([AT_ONCE] if self.text else []), "save all"]
        for each, sweep in itertools.product(driven, sweeps):
            # each from a new start: else rounding makes another point
            commands += ["reset", *(f"alter {n} acmag=0" for n in excited if n not in each)]
            for name, size in each.items():
                commands += [f"alter {name} acmag={size!r}", f"alter {name} acphase=0"]
            commands += [sweep, f"write {RESULT}", "set appendwrite"]
        text = (*(self.text or self.lines), option)
        answers = run_commands(text, commands, find_simulator(), mode=self.mode, seconds=SECONDS)
        if len(answers.plots) != len(driven) * len(sweeps):
            return [], answers.complaint
        return [*answers.plots], ""

    @property
    def probed(self) -> Iterator[str]:
        """The lines, a source, which is off, and the currents into all nodes that it controls."""
        yield from (*self.lines, f"v{PROBE} {PROBE} 0 dc 0 ac 0", f"r{PROBE} {PROBE} 0 1")
        for k, (node, weight) in enumerate(self.weights.items()):
            yield f"g{PROBE}{k} 0 {node} {PROBE} 0 {weight!r}"

    def rest(self, text: Iterable[str], *commands: str, saved: str = "") -> dict[str, float]:
        """Return where ngspice finds a text at rest after some commands; see `read_volts`."""
        every = [*commands, f"save all {saved}", "op", f"write {RESULT}"]
        simulator = find_simulator()
        answers = run_commands(text, every, simulator, mode=self.mode, seconds=TRIED_SECONDS)
        return read_volts(answers)


def find_point(
    lines: Sequence[str], options: str = "", modes: Sequence[str] = MODES, *, volts: bool = False
) -> DeckPoint:
    """Return where a deck rests; of a linear one any point, with its voltages only if `volts`.

    It is read in the first of the `modes` that expands it. `CardError`: it has too many nodes, or
    a card is not read, or ngspice finds no point. `DidNotLoad`: ngspice does not expand it.
    """
    given, simulator = [*lines, *([f".options {options}"] if options else [])], find_simulator()
    said = list[DidNotLoad]()
    for mode in modes:
        try:
            (cards,) = expand(given, simulator, mode=mode)
            break
        except DidNotLoad as error:
            said.append(error)
    else:
        raise said[0]
    flat, found = read_cards(cards, measure=True), dict[str, float]()
    for what, each, most in (("nodes", flat.nodes, MOST_NODES), ("parts", flat.knobs, MOST_PARTS)):
        if len(each) > most:
            raise CardError(f"the deck has {len(each)} {what}; up to {most} are read")
    if flat.elements or volts:
        ask = partial(run_commands, given, simulator=simulator, mode=mode)
        first = ask(commands=AT_REST)
        if not (found := read_volts(first)) and not first.failure:  # such as too long a time
            found = read_volts(ask(commands=(LONGER, *AT_REST), seconds=TRIED_SECONDS))
        if not found:
            raise CardError(f"ngspice finds no operating point: {first.complaint}")
    words = {word for card in cards for word in card.split()}
    nodes = [name for name in found if name in words] if flat.elements else [*flat.nodes]
    drawn = np.random.default_rng(3)
    signs, sizes = drawn.choice([-1.0, 1.0], len(nodes)), drawn.uniform(0.5, 1.0, len(nodes))
    weights = dict(zip(nodes, (signs * sizes).tolist(), strict=True))
    point = DeckPoint(tuple(lines), cards, weights, options, mode, flat, found, OWN)
    if flat.elements:
        return _tight(point)
    return replace(point, limits=TIGHT, text=(*point.probed, f".options {TIGHT} {options}"))


def _tight(point: DeckPoint) -> DeckPoint:
    """Return a point with as many digits as ngspice finds from there, or by itself."""
    asked = [
        f"@{each.name}[{key}]"
        for each in point.flat.elements
        if each.name[0] == "q" and 1 in each.inner
        for key in ("gx", "cbx")
    ]
    shared, first = tuple(point.probed), {node: point.volts[node] for node in point.weights}
    span = max(float(np.ptp([0.0, *first.values()])), UNBIASED)
    for limits, near in itertools.product(TRIED, (True, False)):
        for _ in range(1 + near):  # again: ngspice's last step, which junctions lack, is nearly 0
            starts = point.starts if near else ()
            text = (*shared, f".options {limits} {point.options}", *starts)
            volts = point.rest(text, AT_ONCE, saved=" ".join(asked))
            if not volts or any(abs(volts[n] - v) > ELSEWHERE * span for n, v in first.items()):
                break
            point = replace(point, text=text, volts=volts, limits=limits)
        if point.text:
            break
    return point


def read_volts(answers: Answers) -> dict[str, float]:
    """Return the last operating point that ngspice wrote; nothing where it failed.

    By the name of a node, ``name#branch`` of a current, or ``name[key]``.
    """
    for plot in reversed(answers.plots):
        if any(name.startswith("v(") for name in plot):
            inner = [re.sub(r"^v\((.*)\)$", r"\1", name) for name in plot]
            inner = [re.sub(r"^i\(([^@].*)\)$", r"\1#branch", name) for name in inner]
            plain = [re.sub(r"^i\((.*)\)$", r"\1", name).removeprefix("@") for name in inner]
            volts = (float(values[-1].real) for values in plot.values())
            return dict(zip(plain, volts, strict=True))
    return {}


FREQUENCIES = (1e3, 1e6, 1e9)  # Hz
MISFIT = 1e-4  # of the largest admittance: more is not G + s C
ROUNDED = 1e-12  # of the largest admittance: less is rounding
SMALL = 1e-9  # of the largest capacitance of an element: a difference below is rounding
SAME = 1e-12  # of two gains with opposite signs: they are one of a difference
LEAST_OHMS = 1e-6
RESISTIVE = "; with rgatemod=0 and rbodymod=0 in its .model a BSIM4 has no inner resistances"
Reads = list[tuple[str, float]]  # vectors of a copy, with their signs
Control = tuple[str, ...]


def linear_flat(point: DeckPoint) -> Flat:
    """Return flat cards with linear parts for every element, measured where it rests; no knobs.

    `CardError`: an element is not of the form ``G + s C``, or ngspice does not measure it.
    """
    flat = point.flat
    if not flat.elements:
        return flat
    bench = [_Measured(f"b{k}", each, point.volts) for k, each in enumerate(flat.elements)]
    commands = [*AT_REST, "set appendwrite"]
    for hertz in FREQUENCIES:
        commands += [f"ac lin 1 {hertz!r} {hertz!r}", f"write {RESULT}"]
    cards = [card for each in bench for card in each.cards]
    cards = [*model_cards(flat.models, flat.elements), *cards, f".options {TIGHT} {point.options}"]
    answers = run_commands(cards, commands, find_simulator())
    if len(answers.plots) != 1 + len(FREQUENCIES):
        raise CardError(f"ngspice does not measure the elements alone: {answers.complaint}")
    tables = [{name: values[-1] for name, values in plot.items()} for plot in answers.plots]
    parts, absent, wrong = [*flat.parts], [*flat.absent], list[str]()
    for each in bench:
        text = each.fit(tables, flat.models)
        wrong += [f"{shown(each.element.name)}: {text}"] if text else []
        charges, others = list[Branch](), list[Branch]()  # all or none of the former: a sum of 0
        for part in each.parts():
            (charges if part.letter in "CY" else others).append(part)
        parts += others
        (parts if any(abs(part.value) >= ABSENT for part in charges) else absent).extend(charges)
    if wrong:
        inner = any("rgatemod" in card or "rbodymod" in card for _, card in flat.models.values())
        raise CardError(first_ones(wrong, mark="; ") + RESISTIVE * inner)
    return replace(flat, parts=parts, absent=absent)


class _Measured:
    """An element on the bench, a copy for each node or current that is excited; then its parts."""

    G: Floats  # conductances (rows read, columns held), or gains
    C: Floats  # capacitances, or rates of gains
    rest: Floats  # what is read at rest: currents, A, or voltages, V

    def __init__(self, tag: str, element: Element, volts: Mapping[str, float]) -> None:
        asked = [*element.held, *(f"{name}#branch" for name in element.currents)]
        known = {GROUND: 0.0, **volts}
        if missing := [name for name in asked if name not in known]:
            name = shown(element.name)
            raise CardError(f"{name}: ngspice has no voltage or current {missing[0]!r} at rest")
        self.element, self.held = element, np.array([known[name] for name in asked])  # V and A
        self.ohms = {i: value for i, (_, value) in element.inner.items()}  # before terminals
        if 1 in self.ohms and (siemens := volts.get(f"{element.name}[gx]", 0.0)):
            self.ohms[1] = 1.0 / siemens  # of a base (with RBM) as at rest
        self.ohms = {i: max(value, LEAST_OHMS) for i, value in self.ohms.items()}
        # of a transistor, from its base, before the resistance, to its collector, F
        self.outer = volts.get(f"{element.name}[cbx]", 0.0) if 1 in self.ohms else 0.0
        self.cards = list[str]()
        self.reads = [self._copy(f"{tag}_{j}", j) for j in range(max(len(asked), 1))]

    def _copy(self, tag: str, excited: int) -> Reads:
        """Put a copy on the bench, with one of what it depends on excited."""
        element, rest, count = self.element, self.held.tolist(), len(self.element.held)
        nodes = [f"n{tag}_{i}" for i in range(count)]
        names = {f"i{j}": f"v{tag}_c{j}" for j in range(len(element.currents))}
        names |= {"o0": f"o{tag}_0", "o1": f"o{tag}_1"}
        names |= {f"{i}": node for i, node in enumerate(nodes)}
        card = re.sub(r"\{(\w+)\}", lambda match: names[match[1]], element.pattern)
        self.cards.append(card.replace("~", tag, 1))
        for i, node in enumerate(nodes):
            outer = node
            if i in self.ohms:
                outer = f"x{tag}_{i}"
                self.cards.append(f"rh{tag}_{i} {outer} {node} {self.ohms[i]!r}")
            self.cards.append(f"vh{tag}_{i} {outer} 0 dc {rest[i]!r} ac {int(i == excited)}")
        for j in range(len(element.currents)):
            driven = int(count + j == excited)
            self.cards.append(f"v{tag}_c{j} k{tag}_{j} 0 dc 0")
            self.cards.append(f"ih{tag}_{j} 0 k{tag}_{j} dc {rest[count + j]!r} ac {driven}")
        reads = [(f"i(vh{tag}_{i})", -1.0) for i in range(element.terminals)]
        if element.inner:
            reads += [(f"v({node})", 1.0) for node in nodes[: element.terminals]]
        if element.out:
            self.cards.append(f"vz{tag} o{tag}_1 0 dc 0")
            is_current = element.out[0] == "i"
            self.cards += [f"vo{tag} o{tag}_0 0 dc 0"] if is_current else []
            reads.append((f"i(vo{tag})", -1.0) if is_current else (f"v(o{tag}_0)", 1.0))
        return reads

    def fit(self, tables: Sequence[Mapping[str, complex]], models: Models) -> str:
        """Find its ``G + s C``; return why it is not of this form, or nothing."""
        element, n = self.element, self.element.terminals
        point, *found = (  # what is read (rows) of each copy (columns)
            np.array([[table[name] * sign for name, sign in reads] for reads in self.reads]).T
            for table in tables
        )
        self.rest = point[:, 0].real
        if element.inner:  # currents and voltages of the inner nodes
            self.held[:n], self.rest = self.rest[n:], self.rest[:n]
            try:
                found = [each[:n] @ np.linalg.inv(each[n:]) for each in found]
            except np.linalg.LinAlgError:
                found = [np.full(each[:n].shape, np.nan) for each in found]
            # all currents sum to zero: the one beside the largest conductance is known least
            least = min(self.ohms, key=lambda i: self.ohms[i])
            for each in found:
                each[least] -= each.sum(axis=0)
        self.G, self.C, wrong = _fit(np.array(found))
        wrong = wrong or _wrong_state(element, self.G, self.held, models)
        if not wrong and element.out and element.out[0] == "v" and np.any(self.C):
            wrong = "its voltage depends on the rate of a change"
        if not wrong and element.currents and np.any(self.C[:, len(element.held) :]):
            wrong = "it depends on the rate of a current"
        return wrong

    def parts(self) -> Iterator[Branch]:
        """Yield the linear parts that stand for it."""
        element, n, name = self.element, self.element.terminals, self.element.name
        inner = {i: node for i, (node, _) in element.inner.items()}
        for i, ohms in self.ohms.items():
            yield Branch("R", inner[i], element.held[i], inner[i], ohms)
        ports = [inner.get(i, node) for i, node in enumerate(element.held[:n])]
        if self.outer:
            yield Branch("C", f"{name}#x", element.held[1], ports[0], self.outer)
        end, volts = ports[-1] if n else GROUND, self.held.copy()
        volts[:n] -= volts[n - 1] if n else 0.0
        charging: list[Control] = [(port, end) for port in ports]
        charging += [(node, GROUND) for node in element.held[n:]]
        controls = [*charging, *((card_of(source),) for source in element.currents)]
        rows = [(f"{name}#{i}", "i", port, end) for i, port in enumerate(ports[:-1])]
        rows += [(name, *element.out)] if element.out else []
        for i, (card, kind, a, b) in enumerate(rows):
            constant = float(self.rest[i] - self.G[i] @ volts)
            if a != b or kind == "v":
                yield from sum_parts(card, kind, (a, b), _terms(self.G[i], controls), constant)
        large = np.abs(self.C) > SMALL * float(np.abs(self.C).max(initial=0.0))
        # From the last terminal that has a charge: the others sum to zero, and from another one
        # rounding would be a pole.
        *own, last = [i for i in range(n) if large[i].any() or large[:n, i].any()] or [0]
        ends = {i: (ports[i], ports[last]) for i in own} if n else {0: rows[0][2:]}
        charges = {**(ends if n else {}), **dict(enumerate(charging[n:], n))}
        for (i, (a, b)), (j, control) in itertools.product(ends.items(), charges.items()):
            if large[i, j] and a != b:
                yield Branch("Y", f"{name}#q{i}{j}", a, b, float(self.C[i, j]), control)


def _terms(gains: Floats, controls: Sequence[Control]) -> Iterator[tuple[float, Control]]:
    """Yield gains with what they multiply; two opposite ones are that of a difference."""
    left = [j for j, control in enumerate(controls) if gains[j] and control[1:] != control[:1]]
    while left:
        j = left.pop(0)
        (node, *end), gain = controls[j], float(gains[j])
        for k in left if end else ():
            other, against = controls[k][0], controls[k][-1]
            if [against] == end and abs(gain + gains[k]) <= SAME * abs(gain):
                left.remove(k)
                end = [other]
                break
        yield gain, (node, *end)


def _wrong_state(element: Element, G: Floats, held: Floats, models: Models) -> str:
    """Return whether ngspice left a switch in a state that its control contradicts."""
    if element.name[0] not in "sw":
        return ""
    control = held[2] - held[3] if element.name[0] == "s" else held[2]
    text = next((card for name, (_, card) in models.items() if name in element.pattern.split()), "")
    given = dict(re.findall(r"(\w+) ?= ?([^\s(),]+)", text))
    keys = ("vt", "vh") if element.name[0] == "s" else ("it", "ih")
    threshold, half = (number(given.get(key, "0")) for key in keys)
    on, off = 1.0 / number(given.get("ron", "1")), 1.0 / number(given.get("roff", "1e12"))
    closed = abs(G[0, 0] - on) < abs(G[0, 0] - off)
    if abs(control - threshold) <= abs(half) or closed == (control > threshold):
        return ""
    state = "closed below" if closed else "open above"
    return f"ngspice leaves it {state} its threshold; expected a resistor of its state"


def _fit(responses: Complexes) -> tuple[Floats, Floats, str]:
    """Return G, C, and where the responses (P, rows, columns) are not ``G + s C``."""
    omega = math.tau * np.array(FREQUENCIES)[:, None, None]
    scale = np.abs(responses).max(axis=(1, 2), initial=0.0)
    G, last = responses[0].real, responses[-1].imag
    C = np.where(np.abs(last) > ROUNDED * scale[-1], last / omega[-1], 0.0)
    G = np.where(np.abs(G) > ROUNDED * 1e-3 * scale[0], G, 0.0)
    off = np.abs(responses - G - 1j * omega * C).max(axis=(1, 2), initial=0.0)
    off = off / np.where(scale > 0.0, scale, 1.0)
    if not np.all(np.isfinite(off)):
        return G, C, "ngspice measures no finite small signal of it"
    if np.any(off > MISFIT):
        hertz = FREQUENCIES[int(off.argmax())]
        return G, C, f"its small signal is not G + s C: off by {off.max():.1e} at {hertz:.0e} Hz"
    return G, C, ""
