"""Elements of a deck on one bench: each alone, held where it rests, its ``G + s C`` measured.

One copy stands on the bench for each node or current that is excited. A device with ohmic
resistances is measured without them, and once more with them: both have to be the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from taction.netlist_gen.deck.elements import Element, SortedCards
from taction.netlist_gen.deck.flat_cards import CardError, shown
from taction.spice_models.foreign_expressions import number
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.ngspice.commands import RESULT, run_commands
from taction.verification.engines.ngspice.executable import Simulator

TIGHT = "reltol=1e-9 abstol=1e-15 vntol=1e-12"
FREQUENCIES = (1e3, 1e6, 1e9)  # Hz
MISFIT = 1e-4  # of the largest admittance: more is not G + s C
ROUNDED = 1e-12  # of the largest admittance: less is rounding
LEAST_OHMS = 1e-6
NAMED = 4  # elements in a message
Reads = list[tuple[str, float]]  # vectors of a copy, with their signs
Table = Mapping[str, complex]  # values by vector


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredElement:
    """An element with its small signal between its ports."""

    element: Element
    G: Floats  # conductances (rows read, columns held), or gains
    C: Floats  # capacitances, or rates of gains
    rest: Floats  # what is read at rest: currents, A, or voltages, V
    held: Floats  # what is held at rest, V and A
    ports: tuple[str, ...] = ()  # nodes of the terminals, behind their resistances
    resistors: tuple[tuple[str, str, float], ...] = field(default=())  # terminal, inner node, ohm
    outer: float = 0.0  # of a transistor, from its base, before the resistance, to its collector, F


def measured(
    cards: SortedCards, volts: Mapping[str, float], options: str, simulator: Simulator
) -> list[MeasuredElement]:
    """Measure every element where it rests; `volts` and `options` are those of its `DeckPoint`.

    `CardError`: an element is not of the form ``G + s C``, or ngspice does not measure it.
    """
    if not cards.elements:
        return []
    bench = _Bench(cards, {"0": 0.0, **volts})
    commands = ["save all", "op", f"write {RESULT}", "set appendwrite"]
    for hertz in FREQUENCIES:
        commands += [f"ac lin 1 {hertz!r} {hertz!r}", f"write {RESULT}"]
    answers = run_commands([*bench.cards, f".options {TIGHT} {options}"], commands, simulator)
    if len(answers.plots) != 1 + len(FREQUENCIES):
        raise CardError(f"ngspice does not measure the elements alone: {answers.complaint}")
    tables = [dict(zip(names, values[-1], strict=True)) for names, values in answers.plots]
    found, wrong = list[MeasuredElement](), list[str]()
    for k, element in enumerate(cards.elements):
        made, text = bench.fitted(k, tables)
        found.append(made)
        wrong += [f"{shown(element.name)}: {text}"] if text else []
    if wrong:
        more = f"; and {len(wrong) - NAMED} more" if len(wrong) > NAMED else ""
        raise CardError("; ".join(wrong[:NAMED]) + more)
    return found


class _Bench:
    """The cards of the bench, and what is read of each copy: vectors with their signs."""

    def __init__(self, cards: SortedCards, volts: Mapping[str, float]) -> None:
        self.elements, self.models, self.volts = cards.elements, cards.models, volts
        self.cards = cards.model_cards
        self.reads = {
            f"{kind}{k}": [
                self._copy(f"{kind}{k}_{j}", element, pattern, j)
                for j in range(max(len(element.held) + len(element.currents), 1))
            ]
            for k, element in enumerate(self.elements)
            for kind, pattern in (("b", element.pattern), ("w", element.whole))
            if pattern
        }

    def _held(self, element: Element) -> list[float]:
        try:
            nodes = [self.volts[node] for node in element.held]
            return [*nodes, *(self.volts[f"{name}#branch"] for name in element.currents)]
        except KeyError as error:
            text = f"{shown(element.name)}: ngspice has no voltage or current {error} at rest"
            raise CardError(text) from None

    def _ohms(self, element: Element, i: int) -> float:
        """Return the resistance before a terminal; that of a base (with RBM) is as at rest."""
        siemens = self.volts.get(f"{element.name}[gx]", 0.0) if i == 1 else 0.0
        return max(1.0 / siemens if siemens else element.inner[i][1], LEAST_OHMS)

    def _copy(self, tag: str, element: Element, pattern: str, excited: int) -> Reads:
        """Put a copy on the bench, with one of what it depends on excited."""
        rest, count = self._held(element), len(element.held)
        inner = element.inner if pattern is element.pattern else {}
        nodes = [f"n{tag}_{i}" for i in range(count)]
        names = {f"i{j}": f"v{tag}_c{j}" for j in range(len(element.currents))}
        names |= {f"o{j}": f"o{tag}_{j}" for j in range(2)}
        names |= {f"{i}": node for i, node in enumerate(nodes)}
        card = re.sub(r"\{(\w+)\}", lambda match: names[match[1]], pattern)
        self.cards.append(card.replace("~", tag, 1))
        for i, node in enumerate(nodes):
            outer = node
            if i in inner:
                outer = f"x{tag}_{i}"
                self.cards.append(f"rh{tag}_{i} {outer} {node} {self._ohms(element, i)!r}")
            self.cards.append(f"vh{tag}_{i} {outer} 0 dc {rest[i]!r} ac {int(i == excited)}")
        for j in range(len(element.currents)):
            self.cards.append(f"v{tag}_c{j} k{tag}_{j} 0 dc 0")
            driven = int(count + j == excited)
            self.cards.append(f"ih{tag}_{j} 0 k{tag}_{j} dc {rest[count + j]!r} ac {driven}")
        reads = [(f"i(vh{tag}_{i})", -1.0) for i in range(element.terminals)]
        if inner:
            reads += [(f"v({node})", 1.0) for node in nodes[: element.terminals]]
        for which, _, _ in element.outs:
            self.cards.append(f"vz{tag} o{tag}_1 0 dc 0")
            if which == "i":
                self.cards.append(f"vo{tag} o{tag}_0 0 dc 0")
            if which == "l":
                self.cards.append(f"io{tag} 0 o{tag}_0 dc 0 ac 1")
            reads.append((f"i(vo{tag})", -1.0) if which == "i" else (f"v(o{tag}_0)", 1.0))
        return reads

    def fitted(self, k: int, tables: Sequence[Table]) -> tuple[MeasuredElement, str]:
        """Return an element with ``G + s C``, and why it is not of this form, or nothing."""
        element = self.elements[k]
        n, held = element.terminals, np.array(self._held(element))
        point, *found = (_matrix(self.reads[f"b{k}"], table) for table in tables)
        rest = point[:, 0].real
        if element.inner:  # currents and voltages of the inner nodes
            held[:n], rest = rest[n:], rest[:n]
            found = [each[:n] @ np.linalg.inv(each[n:]) for each in found]
        G, C, wrong = _fit(np.array(found))
        inner = sorted(element.inner.items())
        ports = tuple(element.inner[i][0] if i in element.inner else element.held[i]
                      for i in range(n))  # fmt: skip
        resistors = tuple((element.held[i], name, self._ohms(element, i)) for i, (name, _) in inner)
        outer = self.volts.get(f"{element.name}[cbx]", 0.0) if 1 in element.inner else 0.0
        made = MeasuredElement(element, G, C, rest, held, ports, resistors, outer)
        if element.whole and not wrong:
            wrong = _behind(made, [_matrix(self.reads[f"w{k}"], table) for table in tables[1:]])
        wrong = wrong or _wrong_state(element, G, held, self.models)
        if not wrong and element.outs and element.outs[0][0] == "v" and np.any(C):
            wrong = "its voltage depends on the rate of a change"
        return made, wrong


def _wrong_state(
    element: Element, G: Floats, held: Floats, models: Mapping[str, tuple[str, str]]
) -> str:
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


def _matrix(copies: Sequence[Reads], table: Table) -> Complexes:
    """Return what is read (rows) of each copy (columns)."""
    return np.array([[table[name] * sign for name, sign in reads] for reads in copies]).T


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


def _behind(made: MeasuredElement, whole: Sequence[Complexes]) -> str:
    """Return where a device with its resistances is not what was measured without them."""
    n = made.element.terminals
    ohms, collector, base = np.zeros((n, 1)), *np.eye(n)[:2]
    for i, (_, _, value) in zip(sorted(made.element.inner), made.resistors, strict=True):
        ohms[i] = value
    for hertz, wanted in zip(FREQUENCIES, whole, strict=True):
        s = 2j * math.pi * hertz
        Y, x = made.G[:n, :n] + s * made.C[:n, :n], s * made.outer
        # Inner voltages v for 1 V at each outer terminal; x leads from the outer base.
        loaded = np.eye(n) + ohms * (Y + x * np.outer(collector, collector))
        v = np.linalg.solve(loaded, np.eye(n) + x * ohms * np.outer(collector, base))
        found = Y @ v + x * np.outer(collector - base, v[0] - base)
        miss = np.abs(found - wanted).max() / np.abs(wanted).max()
        if not miss <= MISFIT:
            return f"its resistances are not in series: off by {miss:.1e} at {hertz:.0e} Hz"
    return ""
