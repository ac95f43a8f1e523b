"""ngspice beside the linear circuit of a deck: its small signal, and its transient where asked for.

The small signal is that of the deck as it is, asked twice in one run: from the sources that step,
and from currents of random size into every node, which see every pole, also one that no source
reaches. Two things are no disagreement, and are said where they are more than the limit: what the
rounding of all values does to a node, and the currents that ngspice does not resolve. A node that
only 1 nS holds rests within 1 uV of them, and a junction there has a slope that is known within
4e-5.

The transient is that of the flat cards, with finer and finer steps, until these decide. What two
runs differ by is the error of the steps: a difference to the exact response within it decides
nothing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from taction.netlist_gen.analysis import SimulatedDeck, Transient
from taction.netlist_gen.board.circuit import GROUND, with_parts
from taction.spice_models.branches import Branch, Source
from taction.system.array_types import EPS, PHYSICAL_BOUND, Complexes, Floats
from taction.system.errors import EngineError, SimulationError, first_ones, one_line
from taction.system.processes import time_left
from taction.verification.characterise.operating_point import MISFIT, PROBE, DeckPoint
from taction.verification.engines.ngspice.process import find_simulator, simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.studies.decks.foreign_board import ForeignBoard
from taction.verification.studies.decks.measured_board import FAR, MeasuredBoard
from taction.verification.verdict.checks import Check, Outcome, at_most, undecided

LIMIT = 1e-6  # relative difference of small signals
ROUNDING = 3e4  # times that of one value: some 30 act on a node, and pivots of ngspice are >= 1e-3
THERMAL = 0.0258  # V: no junction changes its slope faster than by e in so much
POINTS = 40
LEAST, MOST = 1e-3, 1e10  # Hz
UNSEEN = 0.2  # of the frequencies: an output that is not resolved at more is not decided
FAINT = 1e-6  # of the largest voltage at a frequency: smaller ones count as this
SHARP = 0.2  # damping below which frequencies about a pole are added


def compare_ac(
    point: DeckPoint, board: LinearBoard, poles: Complexes, absent: Iterable[Branch] = ()
) -> Check:
    """Return the check ``ac_agrees``: the largest relative difference from ngspice's ``.ac``.

    The frequencies are about the `poles`. The board is compared with the `absent` capacitances in
    it, and it is inconclusive where these move an output by more than `MISFIT` of its largest.
    """
    known = board.descriptor.names[: board.descriptor.node_count]
    nodes = [name for name in point.weights if name in known]
    steps = {name: source.step for name, source in stepping(board).items()}
    ask = partial(_theirs, point, nodes, steps, sweeps=list(_sweeps(poles)))
    hertz, theirs, said = ask()
    if not len(hertz):
        return undecided("ac_agrees", "ratio", f"ngspice's .ac was not compared: {said}", LIMIT)
    left_out = [part for part in absent if {*part.nodes} <= {GROUND, *known}]
    whole = LinearBoard(with_parts(board.circuit, left_out)) if left_out else board
    ours, doubt = _ours(point, whole, nodes, hertz)
    size = np.abs(theirs)
    floor = np.maximum(size, FAINT * size.max(axis=2, keepdims=True))
    floor = np.where(floor > 0.0, floor, 1.0)
    off = np.abs(ours - theirs) / floor
    alone = [f"ac lin 1 {each!r} {each!r}" for each in hertz.tolist()]
    # its pivots are those of the first frequency, and its other solver rounds in another way
    for again in ({"sweeps": alone}, {"option": ".options klu"}):
        if np.any(off > LIMIT):
            _, other, _ = ask(**again)
            if other.shape == theirs.shape:  # what both differ by is rounding of ngspice
                doubt = np.fmax(doubt, np.abs(other - theirs))
                off = np.fmin(off, np.abs(ours - other) / floor)
    off = np.where(np.isfinite(off), off, np.inf)
    beyond = np.maximum(off - doubt / floor, 0.0)
    hides = np.any((off > LIMIT) & (beyond <= LIMIT), axis=0).mean(axis=0)
    if left_out:
        without, _ = _ours(point, board, nodes, hertz)
        hides[np.abs(without - ours)[0].max(axis=0) > MISFIT * np.abs(ours)[0].max(axis=0)] = 1.0
    hidden = {name: share for name, share in zip(nodes, hides.tolist(), strict=True) if share}
    way, at, node = (int(k) for k in np.unravel_index(int(beyond.argmax()), beyond.shape))
    worst, how = float(beyond.max()), ("from the source", "from currents into every node")[way]
    outcome = at_most(worst, 0.0, LIMIT)
    reason = f"{len(nodes)} nodes at {len(hertz)} frequencies, from the source and into every node"
    reason = f"largest at {nodes[node]}, {hertz[at]:.4g} Hz, {how}" if worst > 0.0 else reason
    if hidden:
        most, shown = max(hidden.values()) * len(hertz), board.reported(None)
        reason += f"; {first_ones([*hidden])}: not resolved within the limit"
        reason += f" at {most:.0f} of {len(hertz)} frequencies"
        if outcome is Outcome.PASS and any(hidden.get(name, 0.0) > UNSEEN for name in shown):
            outcome = Outcome.INCONCLUSIVE
    return Check("ac_agrees", outcome, worst, 0.0, LIMIT, None, "ratio", reason)


def stepping(board: LinearBoard) -> dict[str, Source]:
    """Return the sources that step, by the names of their cards in ngspice."""
    parts = (part for part in board.circuit.branches if isinstance(part, Source) and part.step)
    return {f"{part.card[0].lower()}{part.card[1:]}": part for part in parts}


def _theirs(
    point: DeckPoint,
    nodes: Sequence[str],
    steps: Mapping[str, float],
    sweeps: Sequence[str],
    option: str = "",
) -> tuple[Floats, Complexes, str]:
    """Return frequencies, both responses (2, F, N), and what ngspice said."""
    tables, said = point.small_signals((steps, {f"v{PROBE}": 1.0}), sweeps, option)
    if missing := [node for node in nodes if tables and f"v({node})" not in tables[0]]:
        tables, said = [], f"it has no voltage of {missing[0]}"
    if not tables:
        return np.zeros(0), np.zeros((2, 0, 0), complex), said
    halves = tables[: len(sweeps)], tables[len(sweeps) :]
    both = [[np.array([table[f"v({n})"] for n in nodes]) for table in half] for half in halves]
    hertz = np.concatenate([table["frequency"].real for table in halves[0]])
    return hertz, np.array([np.concatenate(half, axis=1).T for half in both]), ""


def _ours(
    point: DeckPoint, board: LinearBoard, nodes: Sequence[str], hertz: Floats
) -> tuple[Complexes, Floats]:
    """Return both responses, (2, F, N), and what is not known of them; infinite of a singular A."""
    descriptor = board.descriptor
    places = np.array([descriptor.place(node) for node in nodes], int)
    balances = descriptor.balance_rows[places]
    free = balances < descriptor.size  # not held by a source
    b = np.zeros((descriptor.size, 2))
    b[:, 0] = descriptor.switched
    np.add.at(b[:, 1], balances[free], np.array([point.weights[node] for node in nodes])[free])
    M, K = descriptor.dense.mass, descriptor.dense.stiffness
    solved = [_solved(s * M - K, b) for s in 2j * math.pi * hertz]
    found, unknown = (np.array([x[k][places] for x in solved]).transpose(2, 0, 1) for k in (0, 1))
    slopes = np.zeros(len(nodes))
    if point.flat.elements:
        ohms = free * np.abs(solved[0][2][places, np.where(free, balances, 0)])
        resolved = re.search(r"abstol=(\S+)", point.limits)  # the smallest current, A
        slopes = float(resolved[1] if resolved else 1e-12) * ohms / THERMAL
    return found, np.abs(unknown) + np.abs(found) * slopes


def _solved(A: Complexes, b: Floats) -> tuple[Complexes, Floats, Complexes]:
    """Solve by the inverse of the scaled matrix, and refine; return error and inverse, too."""
    rows = 1.0 / np.maximum(np.abs(A).max(axis=1), 1e-300)
    columns = 1.0 / np.maximum(np.abs(A * rows[:, None]).max(axis=0), 1e-300)
    try:
        inverse = columns[:, None] * np.linalg.inv(A * rows[:, None] * columns) * rows
    except np.linalg.LinAlgError:
        lost = np.full((len(A), b.shape[1]), np.inf)
        return lost.astype(complex), np.zeros(lost.shape), np.zeros(A.shape, complex)
    x = inverse @ b
    for _ in range(2):
        x = x + inverse @ (b - A @ x)
    return x, ROUNDING * EPS * (np.abs(inverse) @ (np.abs(A) @ np.abs(x) + np.abs(b))), inverse


def _sweeps(poles: Complexes) -> Iterator[str]:
    """Yield sweeps: a decade about all poles, and close to the sharpest one."""
    inside = np.abs(poles) / math.tau
    kept = (inside > LEAST) & (inside < MOST)
    poles, sizes = poles[kept], inside[kept]
    low, high = (sizes.min() / 10.0, 10.0 * sizes.max()) if len(sizes) else (1.0, 1e9)
    low, high = max(float(low), LEAST), min(float(high), MOST)
    decades = max(math.log10(high / low), 1.0)
    yield f"ac dec {max(round(POINTS / decades), 1)} {low!r} {high!r}"
    damping = np.where(poles.imag > 0.0, np.abs(poles.real), np.inf) / np.abs(poles)
    if len(sizes) and damping.min() < SHARP:
        hertz = float(sizes[damping.argmin()])
        yield f"ac lin 5 {0.98 * hertz!r} {1.02 * hertz!r}"


RUNS = ((1e-5, 1e3), (1e-6, 4e3), (1e-7, 1.6e4), (1e-8, 6.4e4))  # reltol, least number of steps
LEFT = 0.5  # of what a run differs by from one with steps four times as long: its own error
SETTLED = 0.05  # of a difference beyond the limit: what finer steps may still change of it
FIRST = 0.1  # of the fastest time constant: the first steps of ngspice are of this size
EDGE = 1e-3  # of the first step: the edge of a step in ngspice
_CHARGE = re.compile(r"\bic\s*=\s*\S+")  # which does not count
TIMEOUT = 20.0  # s, of a run


def compare_transient(
    found: MeasuredBoard, deck: ForeignBoard, limit: float, *, ngspice: bool = True
) -> Check:
    """Return the check ``engines_agree``: the largest difference, in step amplitudes.

    A deck that is not linear is not compared: how small a step is small enough is not known.
    """
    stop, amplitude = found.scales.stop, found.measurements.amplitude
    unknown = partial(undecided, "engines_agree", "step", limit=limit)
    if not ngspice:
        return unknown("without ngspice")
    if not deck.is_linear:
        return unknown("the deck is not linear: a step of any size may leave its operating point")
    if found.apart.beyond:
        return unknown(FAR)
    if amplitude == 0.0 or not stop > 0.0:
        return unknown("no output moves")
    if found.poles.known_unstable and math.isfinite(found.scales.growth_time):
        stop = min(stop, found.scales.growth_time)
    simulator, bound = find_simulator(), PHYSICAL_BOUND * max(1.0, amplitude)
    off, error, outcome, why = math.inf, math.inf, Outcome.INCONCLUSIVE, ""
    try:
        exact = exact_solution(found.board, initial=deck.initial)
        fastest = float(np.abs(found.poles.poles).max(initial=1.0 / stop))
        for reltol, steps in RUNS:
            plan = Transient(stop, stop / steps, initial=deck.initial)
            first = min(FIRST / fastest, plan.max_step)
            written = _written(deck, plan, first, f"{simulator.solver_option} reltol={reltol!r}")
            wave = simulate(written, simulator, timeout=time_left(TIMEOUT), bound=bound)
            later = wave.time > 2.0 * EDGE * first
            apart = np.abs(wave.values[later] - exact.at(wave.time[later]))
            before, off = off, float(apart.max()) / amplitude
            error = LEFT * abs(before - off) + exact.error / amplitude
            outcome = at_most(off, error, limit)
            if outcome is Outcome.FAIL and error > SETTLED * off:
                outcome = Outcome.INCONCLUSIVE
            if outcome is not Outcome.INCONCLUSIVE:
                break
    except (EngineError, SimulationError) as problem:
        why = one_line(problem)
    if not math.isfinite(error):
        return unknown(f"ngspice's transient was not compared: {why}")
    reason = f"ngspice's own transient up to {stop:.4g} s"
    reason += f"; finer steps were not compared: {why}" if why else ""
    return Check("engines_agree", outcome, off, error, limit, None, "step", reason)


def _written(deck: ForeignBoard, plan: Transient, first: float, options: str) -> SimulatedDeck:
    """Return the flat cards with the step at t = 0, and a transient with a `first` step, s."""
    cards = [_CHARGE.sub("", line) for line in deck.point.cards if line[0] not in "vi"]
    for part in deck.flat.parts:
        if isinstance(part, Source):
            wave = f"dc {part.value!r}"
            if part.before != part.value and deck.initial == "rest":
                wave = f"dc {part.before!r} PWL(0 {part.before!r} {EDGE * first!r} {part.value!r})"
            cards.append(f"{part.card} {part.a} {part.b} {wave}")
    nodes = tuple(out.node for out in deck.circuit.outputs)
    uncharged = " uic" if deck.initial == "zero" else ""
    closing = [
        f".options {options} method=trap trtol=1 abstol=1e-15 vntol=1e-9",
        ".options chgtol=1e-18 gmin=1e-15 pivtol=1e-18",
        ".save " + " ".join(f"v({node})" for node in nodes),
        f".tran {first!r} {plan.stop!r} 0 {plan.max_step!r}{uncharged}",
        *(".end", ""),
    ]
    return SimulatedDeck("\n".join(["* flat cards of a deck", *cards, *closing]), nodes, plan)
