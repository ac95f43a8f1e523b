"""ngspice beside its cheapest bare run of the same error, and the engine of state space beside it.

`verify` runs with ``analysis.error = 1e-4``. Its decks are run again, in turns with the cheapest
bare ``ngspice -b`` of a ladder of reltol and longest steps whose outputs err by as little, over C
and gain; the last deck in turns with the state space, as many points. Processor times.
"""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.measuring import SCENES, Figure, in_turns, processor, ratios
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.array_types import Waveforms
from taction.system.errors import SimulationError
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.process import find_simulator
from taction.verification.engines.statespace.transients import stepped
from taction.verification.verdict import simulation
from taction.verification.verdict.verify import Verdict, verify

ERROR = 1e-4  # of the step amplitude
FASTER = {"paper-breadboard": 10.0, "tuned-breadboard": 2.5}  # wanted: ngspice over state space
GRID = ("paper-breadboard", "paper-exponential")
C, GAIN = np.geomspace(5e-12, 1e-9, 4).tolist(), np.geomspace(1e5, 2e7, 3).tolist()  # F, ohm
MEAN, LARGEST = 1.2, 2.5  # wanted: verify over the cheapest bare run
RELTOL = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
PARTS = (50, 200, 500, 1000, 2000, 5000, 20_000)  # of the record: the longest step
OWN = (".options reltol", ".options method", ".options chgtol", ".tran")  # not in a bare deck


def measure(tiny: bool) -> list[Figure]:
    """Measure the grid of two boards, and the state space on two."""
    points = [(GRID[0], C[2], GAIN[1])] if tiny else itertools.product(GRID, C, GAIN)
    costs = [cost for point in points for cost in of_a_point(*point)]
    what, base = "verify by ngspice over C and gain", "the cheapest bare run of the same error"
    return [
        Figure(f"{what}, geometric mean", base, costs, MEAN, statistics.geometric_mean(costs)),
        Figure(f"{what}, largest", base, costs, LARGEST, max(costs)),
        *(of_board(name, 1 if tiny else 5) for name in list(FASTER)[tiny:]),
    ]


def run(deck: Deck) -> Waveforms:
    """Run a deck in an ngspice process of its own."""
    return process.simulate(deck, find_simulator(), timeout=600.0)


def verified(scene: Scene) -> tuple[Verdict, list[Deck]]:
    """Return the verdict by ngspice, and the decks that it ran."""
    decks, own = list[Deck](), process.Simulation

    def recorded(deck: Deck, *given: Any, **named: Any) -> Any:
        decks.append(deck)
        return own(deck, *given, **named)

    with mock.patch.object(simulation, "Simulation", recorded):
        return verify(with_values(scene, {"analysis.error": ERROR}).with_engine("ngspice")), decks


def of_a_point(name: str, capacitance: float, gain: float) -> Iterator[float]:
    """Yield the ratio of `verify` to the cheapest bare run, if the board is stable and has one."""
    values = {"design.capacitance": capacitance, "design.gain": gain}
    verdict, decks = verified(with_values(load_scene(SCENES / f"{name}.toml"), values))
    best = cheapest(verdict) if verdict.poles.stable else None
    if best is not None:
        every = processor(lambda: [run(deck) for deck in decks])
        found = in_turns({"verify": every, "bare": processor(lambda: run(best))}, 3)
        yield statistics.median(ratios(found["verify"], found["bare"]))


def cheapest(verdict: Verdict) -> Deck | None:
    """Return the deck of the ladder with the fewest points that errs by at most `ERROR`."""
    best, fewest, beaten = None, np.inf, list[tuple[float, int]]()
    board, analysis = verdict.circuit, verdict.transient
    for parts, reltol in itertools.product(PARTS, RELTOL):
        if any(reltol <= r and parts >= p for r, p in beaten):
            continue
        deck, record = bare(verdict, reltol, analysis.stop / parts), None
        with suppress(SimulationError):
            record = run(deck)
        if record is not None and len(record.time) < fewest:
            true = stepped.simulate(board, analysis, times=record.time, tolerance=1e-9).values
            if np.abs(record.values - true).max() > ERROR * verdict.board.amplitude:
                continue
            best, fewest = deck, len(record.time)
        beaten.append((reltol, parts))
    return best


def bare(verdict: Verdict, reltol: float, longest: float) -> Deck:
    """Return the deck with ngspice's own tolerances but for reltol and a longest step, s."""
    stop, solver = verdict.transient.stop, find_simulator().solver_option
    deck = write_deck(verdict.circuit, verdict.transient, solver=solver)
    kept = [line for line in deck.text.splitlines() if not line.startswith(OWN)]
    tran = f".tran {1e-3 * longest!r} {stop!r} 0 {longest!r} uic"
    cards = [f".options reltol={reltol!r}", tran, ".end", ""]
    return replace(deck, text="\n".join([*kept[: kept.index(".end")], *cards]))


def of_board(name: str, rounds: int) -> Figure:
    """Time one transient of a shipped scene by both engines."""
    verdict, decks = verified(load_scene(SCENES / f"{name}.toml"))
    points = max(verdict.waveforms.cost.points, 2)
    transient = replace(verdict.transient, max_step=verdict.transient.stop / points)
    jobs = {
        "ngspice": processor(lambda: run(decks[-1])),
        "statespace": processor(partial(stepped.simulate, verdict.circuit, transient)),
    }
    found = in_turns(jobs, rounds)
    what, base = f"ngspice at an error of {ERROR:g}, {name}", "state space, as many points"
    times = ratios(found["ngspice"], found["statespace"])
    return Figure(what, base, times, FASTER[name], least=True)
