"""Which poles decide what a designer sees of a board: not those that no output shows, nor far ones.

A stable pole that no output shows is none of the step that is looked at. A growing pole beyond the
band that a small capacitance at every node takes away is one of the models, not of a board.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import Capacitor
from taction.system.array_types import Bools, Complexes, Floats
from taction.system.errors import EngineError
from taction.system.quantities import show, show_rate
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.instant_feedback import NODE, nodes_of
from taction.verification.stability.poles import Poles, poles, summarise

HIDDEN = 1e-9  # of the largest voltage of a mode: outputs with less do not show it
BAND = 1e10  # Hz: no board has a pole beyond
STRAYS = (1e-14, 1e-13, 1e-12)  # F, at every node: one of them takes poles of the models away
NONE: Complexes = np.zeros(0, complex)
NAMED = 3  # poles in a sentence


@dataclass(frozen=True, slots=True, eq=False)
class PolesApart:
    """Poles beside those that decide.

    Attributes
    ----------
    hidden, hidden_errors : ndarray
        Decaying poles that no output shows, 1/s, and their rounding errors.
    unseen : bool
        Whether the fastest growing pole is one that no output shows. It decides, too.
    far : ndarray
        Poles of the models beyond `BAND` that do not decay.
    """

    hidden: Complexes = field(default_factory=lambda: NONE)
    hidden_errors: Floats = field(default_factory=lambda: NONE.real)
    unseen: bool = False
    far: Complexes = field(default_factory=lambda: NONE)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is to be said of them."""
        found = []
        if upper := [p for p in self.hidden.tolist() if p.imag >= 0.0]:
            more = f" and {len(upper) - NAMED} more" if len(upper) > NAMED else ""
            names = ", ".join(map(_shown, upper[:NAMED]))
            found.append(f"no output shows these poles, which decay: {names}{more}")
        if upper := [p for p in self.far.tolist() if p.imag >= 0.0]:
            found.append(
                f"the model itself has a pole at {_shown(upper[0])}, beyond {show(BAND, 'Hz')}: a"
                f" capacitance of at most {show(STRAYS[-1], 'F')} at every node takes it away, so"
                " it does not decide; readings of the step are not known with it"
            )
        return tuple(found)


def _shown(pole: complex) -> str:
    at = f" at {show(pole.imag / math.tau, 'Hz', 4)}" if pole.imag else ""
    return show_rate(pole.real) + at


def told_apart(board: LinearBoard, found: Poles) -> tuple[Poles, PolesApart]:
    """Return the poles that decide, and those beside them; all of a large board decide."""
    if not found.complete or not len(found.poles):
        return found, PolesApart()
    p, errors = found.poles, found.errors
    decays = p.real < -errors
    far = ~decays & (np.abs(p) > math.tau * BAND)
    if np.any(far) and (np.any(~far & (p.real > errors)) or not _of_models(board.circuit)):
        far[:] = False
    unseen = _unseen(board)
    hidden = decays & unseen
    grows = np.flatnonzero(~far & (p.real > errors))
    kept = ~(hidden | far)
    shown = found
    if not np.all(kept):
        shown = replace(summarise(p[kept], complete=True, errors=errors[kept]), doubt=found.doubt)
    apart = PolesApart(p[hidden], errors[hidden], bool(len(grows) and unseen[grows[0]]), p[far])
    return shown, apart


def _unseen(board: LinearBoard) -> Bools:
    """Return which poles, rightmost first, no output shows."""
    space, descriptor = board.state_space, board.descriptor
    modes = space.modes
    C, _ = space.rows(descriptor.names[: descriptor.node_count])
    volts = np.abs(C @ modes.right)
    outputs = [descriptor.place(node) for node in board.reported(None)]
    unseen = volts[outputs].max(axis=0) <= HIDDEN * volts.max(axis=0)
    unseen &= modes.alone
    return np.asarray(unseen[np.lexsort((-modes.poles.imag, -modes.poles.real))])


def _of_models(circuit: Circuit) -> bool:
    """Whether some small capacitance at every node leaves no growing pole.

    A latch keeps its growing pole whatever the capacitance is.
    """
    for farads in STRAYS:
        strays = [Capacitor(NODE.format(node), node, "0", farads) for node in nodes_of(circuit)]
        more = replace(circuit, knobs=(), capacitors=(*circuit.capacitors, *strays))
        try:
            if poles(more).known_stable:
                return True
        except EngineError:
            pass
    return False
