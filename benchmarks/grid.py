"""What the simulations of `verify` cost beside the cheapest bare ngspice, over C and gain.

`verify` runs with ``analysis.error = 1e-4``. Every deck that it gives to ngspice is recorded and
run again, in turns with the cheapest bare run that has the same error: processor times. Last, the
state-space engine beside ngspice at equal error, from the circuit to as many points.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.bare import cheapest, error_of, processor_seconds, true_solution
from benchmarks.measuring import SCENES, Figure, in_turns, processor, ratios
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.ngspice import process
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import simulate
from taction.verification.verdict.verify import Verdict, verify

ERROR = 1e-4  # of the step amplitude
MEAN, LARGEST = 1.2, 2.5  # wanted: times the processor time of the cheapest bare run
C, GAIN = (5e-12, 1e-9), (1e5, 2e7)  # F, ohm
BOARDS = {"linear": "paper-breadboard", "exponential": "paper-exponential"}
FASTER = {"paper-breadboard": 10.0, "tuned-breadboard": 2.5}  # wanted: ngspice over state space
PATIENCE = 2.0  # times the time of `verify`: what takes longer is no cheaper bare run
LEAST_SECONDS, ROUNDS = 1.0, 5  # a board's runs are repeated until one of the two is reached
BARE = "cheapest bare ngspice of the same error"


@dataclass(frozen=True)
class Point:
    """A stable board: error of the record over the wanted one, and ratios of processor times."""

    error: float
    ratios: list[float]  # one for each pair; empty if no bare run reaches the error


def measure(tiny: bool) -> list[Figure]:
    """Measure both boards over the grid, then the engines on two boards."""
    figures: list[Figure] = []
    for kind, name in BOARDS.items():
        scenes = grid(load_scene(SCENES / f"{name}.toml"), *((1, 1) if tiny else (4, 3)))
        found = [point for point in map(measure_point, scenes) if point is not None]
        costs = [statistics.median(point.ratios) for point in found if point.ratios]
        errors, mean = [point.error for point in found], statistics.geometric_mean(costs)
        time = f"grid, {kind}: processor time of the simulations"
        figures += [
            Figure(f"{time}, geometric mean", BARE, costs, MEAN, mean),
            Figure(f"{time}, largest", BARE, costs, LARGEST, max(costs)),
            Figure(f"grid, {kind}: true error", "wanted error", errors, 1.0, max(errors)),
        ]
    names = list(FASTER)[1:] if tiny else list(FASTER)
    return [*figures, *(engines(name, 1 if tiny else 5) for name in names)]


def grid(scene: Scene, rows: int, columns: int) -> Iterator[Scene]:
    """Yield the scenes of the grid, C and gain in geometric progression."""
    for capacitance in np.geomspace(*C, rows + 2 if rows == 1 else rows).tolist()[-rows:]:
        for gain in np.geomspace(*GAIN, columns).tolist():
            values = {"design.capacitance": capacitance, "design.gain": gain}
            yield with_values(scene, values | {"analysis.error": ERROR})


def recorded_verdict(scene: Scene) -> tuple[Verdict, list[Deck]]:
    """Return the verdict by ngspice, and the decks that it ran."""
    decks: list[Deck] = []
    start = process.start

    def recorded(deck: Deck, *given: Any, **named: Any) -> Any:
        decks.append(deck)
        return start(deck, *given, **named)

    with mock.patch.object(process, "start", recorded):
        return verify(scene.with_engine("ngspice")), decks


def measure_point(scene: Scene) -> Point | None:
    """Measure one board; None if it is unstable."""
    verdict, decks = recorded_verdict(scene)
    if not verdict.poles.stable:
        return None
    board, transient, accuracy = (
        LinearBoard.of(verdict.circuit),
        verdict.transient,
        verdict.accuracy,
    )
    truth = true_solution(board, transient)
    best = cheapest(board, transient, truth, ERROR, PATIENCE * accuracy.seconds + 5.0)
    pairs: list[float] = []
    if best is not None:
        bare = best.deck
        jobs = {
            "verify": lambda: sum(processor_seconds(deck) for deck in decks),
            "bare": lambda: processor_seconds(bare),
        }
        found = in_turns(jobs, min(ROUNDS, 1 + int(LEAST_SECONDS / accuracy.seconds)))
        pairs = ratios(found["verify"], found["bare"])
    return Point(error_of(verdict.waveforms, truth, transient.stop) / accuracy.wanted, pairs)


def engines(name: str, rounds: int) -> Figure:
    """Time one transient by both engines, with as many points each."""
    scene = with_values(load_scene(SCENES / f"{name}.toml"), {"analysis.error": ERROR})
    verdict, decks = recorded_verdict(scene)
    points = max(verdict.accuracy.points, 2)
    transient = replace(verdict.transient, max_step=verdict.transient.stop / points)
    jobs = {
        "ngspice": lambda: processor_seconds(decks[-1]),
        "statespace": processor(partial(simulate.simulate, verdict.circuit, transient)),
    }
    found = in_turns(jobs, rounds)
    what, base = f"ngspice at an error of {ERROR:g}, {name}", "state space, as many points"
    times = ratios(found["ngspice"], found["statespace"])
    return Figure(what, base, times, FASTER[name], least=True)
