"""Which poles decide what a designer sees of a board: not those that no output shows, nor far ones.

A stable pole that no output shows is none of the step that is looked at. A growing pole beyond the
band is one of the models, not of a board, where a small capacitance at the nodes that show it takes
it away. So is one that rounding hides, where such a capacitance at every node brings no growing
pole; and one that is gone with a delay of 1 ps in every voltage source with gain and without
capacitors of a negative value, for of these it comes. A latch keeps its pole with all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import Capacitor
from taction.system.array_types import Bools, Complexes, Floats
from taction.system.errors import EngineError
from taction.system.quantities import show, show_rate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.instant_feedback import DELAY, NODE, delayed, nodes_of
from taction.verification.stability.poles import Poles, poles, summarise

HIDDEN = 1e-9  # of the largest voltage of a mode: outputs with less do not show it
SHOWS = 0.1  # of this voltage: nodes with more show a mode beyond the band
BAND = 1e10  # Hz: no board has a pole beyond
STRAYS = (1e-14, 1e-13, 1e-12)  # F: one of them takes poles of the models away
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
            more = f" and {len(upper) - NAMED} more" if len(upper) > NAMED else ""
            names = ", ".join(map(_shown, upper[:NAMED]))
            found.append(f"no output shows these poles, which decay: {names}{more}")
        upper = [f"a pole at {_shown(p)}, beyond {show(BAND, 'Hz')}"
                 for p in self.far.tolist() if p.imag >= 0.0][:1]  # fmt: skip
        if self.lost:
            upper.append("a pole so far away that rounding hides it")
        found += [
            f"the model itself has {pole}: at most {show(STRAYS[-1], 'F')} at a node or"
            f" {show(DELAY, 's')} in a source take it away, so it does not decide; readings of the"
            " step are not known with it"
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
    volts, alone = _volts(board)
    decays, grows = p.real < -errors, p.real > errors
    far = ~decays & (np.abs(p) > math.tau * BAND)
    near = int(np.sum(grows & ~far))
    if np.any(far) and not _of_models(board.circuit, near, _nodes_of(board, volts[:, far])):
        far[:] = False
    lost = board.state_space.lost
    if lost and _of_models(board.circuit, int(np.sum(grows & ~far)), nodes_of(board.circuit)):
        found = replace(found, doubt="")
    outputs = [board.descriptor.place(node) for node in board.reported(None)]
    unseen = alone & (volts[outputs].max(axis=0) <= HIDDEN * volts.max(axis=0))
    hidden = decays & unseen
    first = np.flatnonzero(grows & ~far)
    kept, shown = ~(hidden | far), found
    if not np.all(kept):
        shown = replace(summarise(p[kept], complete=True, errors=errors[kept]), doubt=found.doubt)
    decisive = bool(len(first) and unseen[first[0]])
    return shown, PolesApart(p[hidden], errors[hidden], decisive, p[far], lost)


def _volts(board: LinearBoard) -> tuple[Floats, Bools]:
    """Return how much of each mode, rightmost first, each node shows, and which modes are alone."""
    space, descriptor = board.state_space, board.descriptor
    modes = space.modes
    C, _ = space.rows(descriptor.names[: descriptor.node_count])
    order = np.lexsort((-modes.poles.imag, -modes.poles.real))
    return np.abs(C @ modes.right)[:, order], modes.alone[order]


def _nodes_of(board: LinearBoard, volts: Floats) -> list[str]:
    """Return the nodes that show some of the modes."""
    shows = np.any(volts > SHOWS * volts.max(axis=0), axis=1)
    return [name for name, each in zip(board.descriptor.names, shows, strict=False) if each]


def _of_models(circuit: Circuit, near: int, nodes: Iterable[str]) -> bool:
    """Whether growing poles beyond the band are of the models: `near` other ones grow."""
    nodes = list(nodes)
    for farads in STRAYS:
        strays = [Capacitor(NODE.format(node), node, "0", farads) for node in nodes]
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
