"""ngspice's own transient of a deck beside the exact step response, where it is asked for.

ngspice runs the flat cards with finer and finer steps, until these decide. What two runs differ by
is the error of the steps: a difference to the exact response within it decides nothing.
"""

from __future__ import annotations

import math
import re
from functools import partial

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.check_keys import AGREE
from taction.spice_models.branches import Source
from taction.system.array_types import PHYSICAL_BOUND
from taction.system.errors import EngineError, SimulationError, one_line
from taction.system.processes import time_left
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import simulate
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.studies.decks.foreign_board import ForeignBoard
from taction.verification.studies.decks.measured_board import FAR, MeasuredBoard
from taction.verification.verdict.checks import Check, Outcome, at_most

RUNS = ((1e-5, 1e3), (1e-6, 4e3), (1e-7, 1.6e4), (1e-8, 6.4e4))  # reltol, least number of steps
LEFT = 0.5  # of what a run differs by from one with steps four times as long: its own error
SETTLED = 0.05  # of a difference beyond the limit: what finer steps may still change of it
FIRST = 0.1  # of the fastest time constant: the first steps of ngspice are of this size
EDGE = 1e-3  # of the first step: the edge of a step in ngspice
_CHARGE = re.compile(r"\bic\s*=\s*\S+")  # which does not count
TIMEOUT, LEAST_SECONDS = 20.0, 0.1  # s, of a run; of one for which no time is left


def compare_transient(
    found: MeasuredBoard, deck: ForeignBoard, limit: float | None, *, ngspice: bool = True
) -> Check:
    """Return the check ``engines_agree``: the largest difference, in step amplitudes.

    `limit` is the accepted one, by default `AGREE`. A deck that is not linear is not compared: how
    small a step is small enough is not known.
    """
    limit, stop, amplitude = limit or AGREE, found.scales.stop, found.amplitude
    unknown = partial(Check, "engines_agree", Outcome.INCONCLUSIVE, None, None, limit, None, "step")
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
            first, longest = min(FIRST / fastest, stop / steps), stop / steps
            written = _written(deck, stop, first, longest, reltol, simulator.solver_option)
            seconds = max(time_left(TIMEOUT), LEAST_SECONDS)
            wave = simulate(written, simulator, timeout=seconds, bound=bound)
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


def _written(
    deck: ForeignBoard, stop: float, first: float, longest: float, reltol: float, solver: str
) -> Deck:
    """Return the flat cards with the step at t = 0, and a transient with these steps, s."""
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
        f".options {solver} method=trap trtol=1 reltol={reltol!r} abstol=1e-15 vntol=1e-9",
        ".options chgtol=1e-18 gmin=1e-15 pivtol=1e-18",
        ".save " + " ".join(f"v({node})" for node in nodes),
        f".tran {first!r} {stop!r} 0 {longest!r}{uncharged}",
        *(".end", ""),
    ]
    text = "\n".join(["* flat cards of a deck", *cards, *closing])
    return Deck(text, nodes, Transient(stop, longest, initial=deck.initial))
