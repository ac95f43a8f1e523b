"""The operating point of a deck as it is, every transistor and clamp in it, as ngspice finds it.

ngspice expands the deck and finds a first point as it does by itself, then a tight one from there.
The text of the second run is kept: whoever asks ngspice about the point sends the same text, so
that ngspice repeats this point to the last bit. It has a source of current into every node, which
`studies.witnesses` drives.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.deck.elements import CardError
from taction.netlist_gen.deck.flat_cards import Flat, read_cards
from taction.verification.characterise.element_bench import TIGHT
from taction.verification.engines.ngspice.commands import (
    RESULT,
    TEXT,
    Answers,
    listed_cards,
    run_commands,
)
from taction.verification.engines.ngspice.executable import Simulator

AT_ONCE = "optran 1 1 1 0 0 0"  # no transient to the operating point
TRIED = (
    TIGHT,
    "reltol=1e-6 abstol=1e-13 vntol=1e-10",
    "reltol=1e-5 abstol=1e-13 vntol=1e-7",
    "reltol=1e-4 abstol=1e-12 vntol=1e-6",
    "reltol=1e-3",
    f"{TIGHT} klu pivrel=0.9",
)
"""Tolerances of ngspice in the order in which they are tried; in the end with its other solver."""
OWN = "a transient"  # limits of a point that ngspice finds in no other way
TRIED_SECONDS = 4.0
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
    limits: str  # tolerances of ngspice with which it was found
    text: tuple[str, ...] = ()  # with it, after `AT_ONCE`, ngspice finds the point again; or empty

    @classmethod
    def of(
        cls,
        lines: Sequence[str],
        cards: Sequence[str],
        flat: Flat,
        nodes: Sequence[str],
        options: str = "",
        mode: str = "",
    ) -> DeckPoint:
        """Return any point of a linear deck: it is the same everywhere."""
        drawn = np.random.default_rng(3)
        signs, sizes = drawn.choice([-1.0, 1.0], len(nodes)), drawn.uniform(0.5, 1.0, len(nodes))
        weights = dict(zip(nodes, (signs * sizes).tolist(), strict=True))
        point = cls(tuple(lines), tuple(cards), weights, options, mode, flat, {}, TIGHT)
        return replace(point, text=(*point.probed, f".options {TIGHT} {options}"))

    @property
    def is_tight(self) -> bool:
        """Whether it is known to nine digits."""
        return self.limits.startswith(TIGHT)

    @property
    def unresolved(self) -> float:
        """The smallest current that ngspice resolves, A."""
        given = re.search(r"abstol=(\S+)", self.limits)
        return float(given[1]) if given else 1e-12  # ngspice's own

    @property
    def starts(self) -> list[str]:
        """Cards that make ngspice start at this point."""
        return [f".nodeset v({node})={self.volts[node]!r}" for node in self.weights]

    @property
    def probed(self) -> Iterator[str]:
        """The lines, a source, which is off, and the currents into all nodes that it controls."""
        yield from (*self.lines, f"v{PROBE} {PROBE} 0 dc 0 ac 0", f"r{PROBE} {PROBE} 0 1")
        for k, (node, weight) in enumerate(self.weights.items()):
            yield f"g{PROBE}{k} 0 {node} {PROBE} 0 {weight!r}"


def find_point(
    lines: Sequence[str], options: str, simulator: Simulator, modes: Sequence[str] = MODES
) -> DeckPoint:
    """Return where a deck rests; it is read in the first of the `modes` that expands it.

    `CardError`: ngspice does not expand it, or finds no point; or a card is not read.
    """
    first, said = Answers((), "", ""), ""
    commands = [f"listing expand > {TEXT}", "save all", "op", f"write {RESULT}"]
    given = [f".options {options}"] if options else []
    for mode in modes:
        first = run_commands([*lines, *given], commands, simulator, mode=mode)
        said = said or first.complaint
        if cards := listed_cards(first.listed):
            break
    else:
        raise CardError(f"ngspice does not expand the deck: {said}")
    flat, volts = read_cards(cards, measure=True), read_volts(first)
    words = {word for card in cards for word in card.split()}
    nodes = [name for name in volts if name in words]
    linear = DeckPoint.of(lines, cards, flat, nodes, options, mode)
    if not flat.elements:
        return linear
    if not volts:
        raise CardError(f"ngspice finds no operating point: {first.complaint}")
    return _tight(replace(linear, volts=volts, limits=OWN, text=()), simulator)


def _tight(point: DeckPoint, simulator: Simulator) -> DeckPoint:
    """Return a point with as many digits as ngspice finds from there, or by itself."""
    asked = [
        f"@{each.name}[{key}]"
        for each in point.flat.elements
        if each.name[0] == "q" and 1 in each.inner
        for key in ("gx", "cbx")
    ]
    shared = tuple(point.probed)
    commands = [AT_ONCE, f"save all {' '.join(asked)}", "op", f"write {RESULT}"]
    for limits, near in itertools.product(TRIED, (True, False)):
        for _ in range(1 + near):  # again: ngspice's last step, which junctions lack, is nearly 0
            starts = point.starts if near else ()
            text = (*shared, f".options {limits} {point.options}", *starts)
            answers = run_commands(
                text, commands, simulator, mode=point.mode, seconds=TRIED_SECONDS
            )
            if not (volts := read_volts(answers)):
                break
            point = replace(point, text=text, volts=volts, limits=limits)
        if point.text:
            break
    return point


def read_volts(answers: Answers) -> dict[str, float]:
    """Return the last operating point that ngspice wrote; nothing where it failed.

    By the name of a node, ``name#branch`` of a current, or ``name[key]``.
    """
    for names, values in reversed(answers.plots):
        if any(name.startswith("v(") for name in names):
            return dict(zip(map(_plain, names), values[-1].real.tolist(), strict=True))
    return {}


def _plain(name: str) -> str:
    """Return the name of a vector as a node, ``name#branch`` or ``name[key]``."""
    inner = name.lower()
    if inner.startswith(("v(", "i(")) and inner.endswith(")"):
        branch = "#branch" if inner.startswith("i(") and "@" not in inner else ""
        inner = inner[2:-1] + branch
    return inner.removeprefix("@")
