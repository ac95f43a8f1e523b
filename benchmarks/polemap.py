"""A map of rightmost poles over C and gain, beside ngspice transients of the same boards."""

from __future__ import annotations

import random
import statistics
import time

import numpy as np

from benchmarks.engines import STEPS, Board
from benchmarks.measuring import SCENES, Extent, Figure, Result
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.stability.poles import poles_together

C, GAIN = (2e-12, 50e-12), (1e6, 20e6)  # F, ohm
RIVALS: tuple[tuple[str, dict[str, Value], float | None], ...] = (
    ("with 125 points a period", {"analysis.points_per_period": 125.0}, 50.0),
    ("as verify plans it", STEPS, None),
)
SIZES = {Extent.TINY: (2, 1), Extent.QUICK: (24, 12), Extent.FULL: (64, 48)}  # side, sample


def grid(scene: Scene, side: int) -> list[Scene]:
    """Return the scenes of the map, logarithmic."""
    return [
        with_values(scene, {"design.capacitance": capacitance, "design.gain": gain})
        for capacitance in np.geomspace(*C, side).tolist()
        for gain in np.geomspace(*GAIN, side).tolist()
    ]


def measure(extent: Extent) -> Result:
    """Map the poles, and time ngspice on a random sample of the map."""
    side, size = SIZES[extent]
    scene = load_scene(SCENES / "paper-breadboard.toml")
    poles_together([synthesise(scene)])  # what is imported on first use
    begun = time.perf_counter()
    scenes, problem = grid(scene, side), make_problem(scene)
    poles_together(synthesise(each, problem) for each in scenes)
    point = (time.perf_counter() - begun) / len(scenes)
    sample = random.Random(1993).sample(scenes, size)  # noqa: S311 - no secret
    figures = []
    for who, steps, wanted in RIVALS:
        boards = [Board.of(each, steps) for each in sample]
        times = [board.ngspice() / point for board in boards]
        what = f"ngspice {who}, mean of {size} points of a map of {side} x {side}"
        base = "rightmost pole of a point"
        figures.append(Figure(what, base, times, wanted, statistics.mean(times), least=True))
    return Result(figures)
