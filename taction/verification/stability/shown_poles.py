"""Which poles decide what a designer sees of a board: not those that no output shows, nor far ones.

A stable pole that no output shows is none of the step that is looked at. A growing pole beyond the
band is one of the models, not of a board, where a small capacitance at the nodes that show it takes
it away. So is one that rounding hides, where such a capacitance at every node brings no growing
pole; and one that is gone with a delay of 1 ps in every voltage source with gain and without
capacitors of a negative value, for of these it comes. A latch keeps its pole with all of them.

A source with gain that follows at once has no pole. With positive feedback and a loop gain above 1
it still has an equilibrium, and the equations say that it rests there; any delay makes it leave.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.spice_models.branches import Branch
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError, first_ones
from taction.system.quantities import show, show_rate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.poles import Poles, poles

HIDDEN = 1e-9  # of the largest voltage of a mode: outputs with less do not show it
SHOWS = 0.1  # of this voltage: nodes with more show a mode beyond the band
BAND = 1e10  # Hz: no board has a pole beyond
STRAY, DELAY = 1e-15, 1e-12  # F at every node, s of every voltage source with gain
NODE = "{}_taction_delay"
STRAYS = (1e-14, 1e-13, 1e-12)  # F, at 1 ohm or more: one of them takes poles of models away
FAINTS = (1e-18, 1e-16, 1e-15)  # F, at every node beside such a delay: likewise
NONE: Complexes = np.zeros(0, complex)
NAMED = 3  # poles in a sentence


@dataclass(frozen=True, slots=True, eq=False)
class PolesApart:
    """Poles beside those that decide."""

    # `hidden`, `hidden_errors`: decaying poles that no output shows, 1/s, and their rounding
    # errors.
    hidden: Complexes = field(default_factory=lambda: NONE)
    hidden_errors: Floats = field(default_factory=lambda: NONE.real)
    # Whether the fastest growing pole is one that no output shows. It decides, too.
    unseen: bool = False
    # Poles of the models beyond `BAND` that do not decay.
    far: Complexes = field(default_factory=lambda: NONE)
    lost: int = 0  # how many poles of the models are so far away that rounding hides them

    @property
    def beyond(self) -> bool:
        """Whether the models have poles beyond the band that do not decay, as far as is known."""
        return bool(len(self.far) or self.lost)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is to be said of them."""
        found = []
        if upper := [p for p in self.hidden.tolist() if p.imag >= 0.0]:
            names = first_ones([*map(_shown, upper)], NAMED)
            found.append(f"no output shows these poles, which decay: {names}")
        upper = [f"a pole at {_shown(p)}, beyond {show(BAND, 'Hz')}"
                 for p in self.far.tolist() if p.imag >= 0.0][:1]  # fmt: skip
        if self.lost:
            upper.append("a pole so far away that rounding hides it")
        found += [
            f"the model itself has {pole}: at most {show(STRAYS[-1], 'F')} or {show(DELAY, 's')} at"
            " a node or in a source take it away, so it does not decide; readings of the step are"
            " not known with it"
            for pole in upper
        ]
        return tuple(found)


def _shown(pole: complex) -> str:
    at = f" at {show(pole.imag / math.tau, 'Hz', 4)}" if pole.imag else ""
    return show_rate(pole.real) + at


def told_apart(board: LinearBoard, found: Poles) -> tuple[Poles, PolesApart]:
    """Return the poles that decide, and those beside them; all of a large board decide."""
    if not found.complete or not len(found.poles):
        return found, PolesApart()
    p, errors = found.poles, found.errors
    known = np.where(np.abs(p.imag) > errors, p, p.real)  # without frequencies that are rounding
    descriptor, modes = board.descriptor, board.state_space.modes
    every = descriptor.names[: descriptor.node_count]
    volts = np.abs(board.state_space.rows(every)[0] @ modes.right)  # of each mode at each node
    decays, grows = p.real < -errors, p.real > errors
    far = ~decays & (np.abs(p) > math.tau * BAND)
    near = int(np.sum(grows & ~far))
    if np.any(far):
        shows = np.any(volts[:, far] > SHOWS * volts[:, far].max(axis=0), axis=1)
        far &= _of_models(board.circuit, near, compress(every, shows))
    lost = board.state_space.lost
    if lost and _of_models(board.circuit, int(np.sum(grows & ~far)), nodes_of(board.circuit)):
        found = replace(found, doubt="")
    outputs = [descriptor.place(node) for node in board.reported(None)]
    unseen = modes.alone & (volts[outputs].max(axis=0) <= HIDDEN * volts.max(axis=0))
    hidden = decays & unseen
    first = np.flatnonzero(grows & ~far)
    p, kept = np.where(decays | far, known, p), ~(hidden | far)
    shown = replace(found, poles=p[kept], errors=errors[kept])
    decisive = bool(len(first) and unseen[first[0]])
    return shown, PolesApart(p[hidden], errors[hidden], decisive, p[far], lost)


def _of_models(circuit: Circuit, near: int, nodes: Iterable[str]) -> bool:
    """Whether growing poles beyond the band are of the models: `near` other ones grow.

    At a node with resistors of less than 1 ohm a capacitance has the time constant that the stray
    capacitance has at 1 ohm: there a negative capacitance of the model may be as large.
    """
    nodes, siemens = list(nodes), dict[str, float]()
    for part in circuit.resistors:
        for node in (part.a, part.b):
            siemens[node] = siemens.get(node, 0.0) + abs(1.0 / part.ohms)
    for farads in STRAYS:
        strays = [
            Capacitor(NODE.format(node), node, GROUND, farads * max(siemens.get(node, 0.0), 1.0))
            for node in nodes
        ]
        more = replace(circuit, knobs=(), capacitors=(*circuit.capacitors, *strays))
        if len(_growing(more)) == near:
            return True
    return any(
        np.all(np.abs(_growing(delayed(circuit, farads))) <= math.pi * BAND) for farads in FAINTS
    )


def _growing(circuit: Circuit) -> Complexes:
    """Return the poles that do not decay; an infinite one where rounding hides some."""
    try:
        found = poles(circuit)
    except EngineError:
        return np.array([math.inf], complex)
    if found.doubt:
        return np.array([math.inf], complex)
    return np.asarray(found.poles[found.poles.real >= -found.errors])


def latching(circuit: Circuit) -> str:
    """Return why a circuit that its poles call stable latches with any delay; empty if not.

    With `STRAY` at every node and `DELAY` in every voltage source with gain a positive loop gain
    above 1 has a growing real pole. Growing pairs of this circuit say nothing: there the values of
    both matter.
    """
    if not _acts_at_once(circuit):
        return ""
    try:
        found = poles(delayed(circuit, STRAY))
    except EngineError:
        return ""
    real = found.poles.real[(found.poles.imag == 0.0) & (found.poles.real > found.errors)]
    if not len(real):
        return ""
    return (
        "positive feedback, as of exchanged inputs of an op-amp, which latches as soon as anything"
        f" has a delay (with {show(STRAY, 'F')} at every node and {show(DELAY, 's')} in every"
        f" voltage source with gain a real pole grows with {show(float(np.max(real)), '1/s', 2)})"
    )


def _acts_at_once(circuit: Circuit) -> bool:
    """Whether a source with gain acts on what controls it without a state between.

    Known are the voltages that follow from states and from sources without gain. Nodes that
    capacitors join to known ones are states, unless they join a voltage source with gain, too.
    Nodes that resistors join to known ones are known, if no source whose control is not known acts
    on them.
    """
    if any(part.letter in "FH" for part in circuit.branches):
        return True  # what a current depends on is not followed
    gains = [part for part in circuit.branches if part.letter in "EGY"]
    sources = [part for part in circuit.branches if part.letter == "V"]
    ends = {node for part in gains if part.letter == "E" for node in (part.a, part.b)}
    states = [(part.a, part.b) for part in circuit.capacitors]
    pairs = [*states, *((r.a, r.b) for r in circuit.resistors), *((v.a, v.b) for v in sources)]
    known, size = {GROUND}, 0
    while len(known) > size:
        size = len(known)
        follows = [part for part in gains if known.issuperset(part.control)]
        for part in (*sources, *(part for part in follows if part.letter == "E")):
            known.update((part.a, part.b) if not known.isdisjoint((part.a, part.b)) else ())
        for group in _groups(states, known):
            tied = any(not (group.isdisjoint(p) or known.isdisjoint(p)) for p in states)
            known |= group if tied and group.isdisjoint(ends) else set()
        acted = {n for part in gains if part not in follows for n in (part.a, part.b)} | ends
        for group in _groups(pairs, known):
            known |= group if group.isdisjoint(acted) else set()
    return not all(known.issuperset(part.control) for part in gains)


def _groups(pairs: Sequence[tuple[str, str]], known: set[str]) -> Iterator[set[str]]:
    """Yield the nodes, without the known ones, that pairs of nodes join."""
    groups = dict[str, set[str]]()
    for pair in pairs:
        group = {node for node in pair if node not in known}
        for node in tuple(group):
            group |= groups.get(node, set())
        groups |= dict.fromkeys(group, group)
    yield from {id(group): group for group in groups.values()}.values()


def delayed(circuit: Circuit, farads: float) -> Circuit:
    """Return the circuit with a capacitance, F, at every node, and `DELAY` in every voltage source.

    Only sources with gain are meant. Capacitors of a negative value are left out, and capacitances
    where a subcircuit has a negative resistance in series with a transistor: their growing poles
    are no feedback.
    """
    branches, resistors, capacitors = list[Branch](), list[Resistor](), list[Capacitor]()
    negative, positive = (
        {node for part in circuit.resistors if part.ohms * sign > 0.0 for node in (part.a, part.b)}
        for sign in (-1.0, 1.0)
    )
    in_series = {node for node in negative - positive if "." in node}
    for part in circuit.branches:
        node = NODE.format(part.name)
        if part.letter not in "EH":
            branches.append(part)
            continue
        letter = "G" if part.letter == "E" else "F"
        branches.append(Branch(letter, node, GROUND, node, part.value, part.control))
        branches.append(Branch("E", part.name, part.a, part.b, 1.0, (node, GROUND)))
        resistors.append(Resistor(node, node, GROUND, 1.0))
        capacitors.append(Capacitor(node, node, GROUND, DELAY))
    capacitors += [part for part in circuit.capacitors if part.farads > 0.0]
    capacitors += [Capacitor(NODE.format(node), node, GROUND, farads)
                   for node in nodes_of(circuit) if node not in in_series]  # fmt: skip
    return replace(
        circuit,
        knobs=(),
        branches=tuple(branches),
        resistors=(*circuit.resistors, *resistors),
        capacitors=tuple(capacitors),
    )


def nodes_of(circuit: Circuit) -> Iterator[str]:
    """Yield the nodes of a circuit without ground."""
    plain: list[Resistor | Capacitor] = [*circuit.resistors, *circuit.capacitors]
    nodes = [node for part in plain for node in (part.a, part.b)]
    nodes += [node for part in circuit.branches for node in part.nodes]
    nodes += [n for c in circuit.opamps for n in (c.noninverting, c.inverting, c.output)]
    yield from dict.fromkeys(node for node in nodes if node != GROUND)
