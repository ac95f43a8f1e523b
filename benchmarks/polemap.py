"""A map of rightmost poles over C and gain, beside ngspice transients of the same boards."""

from __future__ import annotations

import random
import time

import numpy as np

from benchmarks.engines import Board
from benchmarks.measuring import SCENES, Extent, Figure, Result
from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_values
from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import Scene
from verification.small_signal.poles import poles

C, GAIN = (2e-12, 50e-12), (1e6, 20e6)  # F, ohm
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
    poles(synthesise(scene))  # what is imported on first use
    begun = time.perf_counter()
    scenes = grid(scene, side)
    for each in scenes:
        poles(synthesise(each))
    point = (time.perf_counter() - begun) / len(scenes)
    sample = random.Random(1993).sample(scenes, size)  # noqa: S311 - no secret
    seconds = [Board.of(each).ngspice() / point for each in sample]
    mean = sum(seconds) / len(seconds)
    what = f"ngspice, mean time of {size} points of a map of {side} x {side}"
    return Result([Figure(what, "rightmost pole of a point", seconds, 50.0, mean, least=True)])
