"""What the operating point of a deck that is not linear leaves open: other points, a large step.

Latches, Schmitt triggers and current references have several operating points, and ngspice may
find the one that no board keeps. A large step leaves the range in which the circuit is linear.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.characterise.operating_point import AT_ONCE, DeckPoint, read_volts
from taction.verification.engines.ngspice.commands import RESULT, run_commands
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.studies.measured_board import MeasuredBoard
from taction.verification.studies.part_influence import pole_vectors
from taction.verification.studies.witnesses import stepping

STARTS = 12
REACHES = (0.05, 0.15, 0.4, 1.0, 10.0)  # of the range of all voltages, along the growing mode
WIDER = 2.0  # times this range on either side: drawn voltages
SAME = 1e-3  # of this range, or of a voltage: a smaller distance is the same point
SECONDS = 4.0  # of one start
ALL_SECONDS = 8.0  # of all starts: no further one begins later
TINY = 1e-30  # V: of no step at all
LARGE = 0.01  # of the step, or of a node's own: how far ngspice's rest may be from the linear one


def _rest(point: DeckPoint, limits: str, cards: Iterable[str], *commands: str) -> dict[str, float]:
    """Return where ngspice finds the deck at rest with other cards; nothing where it does not."""
    text = [*point.lines, f".options {limits} {point.options}", *cards]
    every = [*commands, "save all", "op", f"write {RESULT}"]
    simulator = find_simulator()
    return read_volts(run_commands(text, every, simulator, mode=point.mode, seconds=SECONDS))


def points_note(found: MeasuredBoard, point: DeckPoint) -> str:
    """Return how many operating points a deck with a growing real pole has; empty without one.

    ngspice starts along the growing mode, both ways, and from voltages that are drawn.
    """
    poles = found.poles
    growing = (poles.poles.imag == 0.0) & (poles.poles.real > poles.errors)
    if not np.any(growing):
        return ""
    nodes = [name for name in found.board.descriptor.names if name in point.volts]
    here = np.array([point.volts[name] for name in nodes])
    span = float(np.ptp(here, axis=0)) or 1.0
    known, tried, end = [here], 0, time.monotonic() + ALL_SECONDS
    for start in _starts(found, complex(poles.poles[growing][0]), nodes, here, span):
        if time.monotonic() > end:
            break
        tried += 1
        cards = [f".nodeset v({n})={v!r}" for n, v in zip(nodes, start.tolist(), strict=True)]
        volts = _rest(point, "reltol=1e-6 abstol=1e-13 vntol=1e-10", cards, AT_ONCE)
        if not volts:
            continue
        there = np.array([volts.get(name, np.nan) for name in nodes])
        if all(np.abs(there - each).max() > SAME * span for each in known):
            known.append(there)
    if len(known) == 1:
        return f"from {tried} other starts ngspice finds no operating point but this unstable one"
    out = found.board.circuit.outputs[0].node
    shown = out if out in nodes else nodes[int(np.abs(known[1] - here).argmax())]
    at = nodes.index(shown)
    own, *others = (show(float(each[at]), "V", 4) for each in known)
    return (
        f"at least {len(known)} operating points: all that follows is of this one, which is"
        f" unstable, with v({shown}) = {own}; the others have {', '.join(others)}"
    )


def _starts(
    found: MeasuredBoard, pole: complex, nodes: list[str], here: Floats, span: float
) -> Iterator[Floats]:
    drawn, count = np.random.default_rng(5), 0
    try:
        right, _ = pole_vectors(found.board, pole)
        places = [found.board.descriptor.place(name) for name in nodes]
        mode = right[places].real / np.abs(right[places]).max()
        for reach in REACHES:
            yield here + reach * span * mode
            yield here - reach * span * mode
            count += 2
    except EngineError:
        pass
    for _ in range(STARTS - count):
        yield drawn.uniform(here.min() - WIDER * span, here.max() + WIDER * span, len(here))


def step_note(found: MeasuredBoard, point: DeckPoint) -> str:
    """Return that a step leaves the range in which a deck is linear; empty where it does not."""
    if not found.poles.known_stable:
        return ""
    alter = (f"alter {name} dc={s.value!r}" for name, s in stepping(found.board).items())
    volts = _rest(point, "reltol=1e-6", point.starts, *alter)
    if not volts:
        return "ngspice finds no operating point after the step: readings hold for small steps only"
    values, places = found.board.equilibrium.values, found.board.descriptor.places
    step = max(found.measurements.amplitude, TINY)
    off, name, linear, true = max(
        (max(abs(values[places[n]] - v) - SAME * abs(v), 0.0) / max(step, abs(v - point.volts[n])),
         n, float(values[places[n]]), v)
        for n, v in volts.items()
        if n in places and n in point.volts
    )  # fmt: skip
    if off <= LARGE:
        return ""
    return (
        f"the step is too large for small signals: after it ngspice's operating point has v({name})"
        f" = {show(true, 'V', 4)}, the linear circuit {show(linear, 'V', 4)}; readings of the step"
        " hold for small steps only"
    )
