"""Feedback that acts at once: whether a circuit of ideal sources would latch if it had a delay.

A source with gain that follows at once has no pole. With positive feedback and a loop gain above 1
it still has an equilibrium, and the equations say that it rests there; any delay makes it leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.spice_models.branches import Branch
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.stability.poles import poles

STRAY, DELAY = 1e-15, 1e-12  # F at every node, s of every voltage source with gain
NODE = "{}_taction_delay"


def latching(circuit: Circuit) -> str:
    """Return why a circuit that its poles call stable latches with any delay; empty if not.

    With `STRAY` at every node and `DELAY` in every voltage source with gain a positive loop gain
    above 1 has a growing real pole. Growing pairs of this circuit say nothing: there the values of
    both matter.

    Examples
    --------
    >>> from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
    >>> for gain in ("-1e6", "1e6"):
    ...     cards = ["v1 in 0 1", "r1 in n 1k", "r2 n out 10k", f"e1 out 0 n 0 {gain}"]
    ...     print(bool(latching(circuit_of(read_cards(cards), "inverter", ["out"]))))
    False
    True
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

    Only sources with gain are meant. Capacitors of a negative value are left out: their growing
    poles are no feedback.
    """
    branches, resistors, capacitors = list[Branch](), list[Resistor](), list[Capacitor]()
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
    capacitors += [Capacitor(NODE.format(node), node, GROUND, farads) for node in nodes_of(circuit)]
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
