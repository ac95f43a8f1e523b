"""Whole verdicts of large boards and of closed loops with wires: processor time and memory."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.measuring import (
    Cost,
    Figure,
    imports,
    in_seconds,
    in_turns,
    processor,
    python,
    taction,
)
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.verification.verdict.verify import verify

SCENE = """
name = "large-board"
[problem]
kind = "tactile"
channels = {channels}
span = 16.0
quadrature = "rectangle"
[design]
amplifier = "{amplifier}"
capacitance = "220pF"
gain = "500kohm"
unit_conductance = "2uS"
lambda = 0.1
opamp = {{ base = "tl084", input_errors = "none" }}
stray_capacitance = "2pF"
[checks]
steady_state = {{ tolerance = 1e-2 }}
"""
JOBS = {  # channels, amplifier and engine, and the wanted processor time, s
    (64, "linear", "statespace"): 1.5,
    (64, "linear", "ngspice"): 12.0,
    (64, "exponential", "statespace"): 5.0,
    (200, "linear", "statespace"): 1.6,
    (500, "linear", "statespace"): 5.0,
}
TINY = {(3, "linear", "ngspice"): None}
MEMORY = 600.0  # MB, wanted of every command
FEEDBACK: dict[str, dict[str, Value]] = {
    "inv": {},
    "pinv": {"design.feedback_conductance": 1.04e-3},  # 3 times the least one
}
WIRED = {"inv": 4.5, "pinv": 8.0}  # wanted, s


def measure(tiny: bool) -> list[Figure]:
    """Run every command in turns with the imports that every command needs."""
    figures, peaks = [], []
    with tempfile.TemporaryDirectory() as folder:
        for (channels, amplifier, engine), wanted in (TINY if tiny else JOBS).items():
            scene = Path(folder) / f"{channels}-{amplifier}.toml"
            scene.write_text(SCENE.format(channels=channels, amplifier=amplifier))
            verdict = partial(taction, "verify", str(scene), "--engine", engine)
            jobs: dict[str, Callable[[], Cost]] = {"verify": verdict, "imports": imports}
            found = in_turns(jobs, 1 if tiny else 3, warm=False)
            spent, base = ([cost.processor for cost in found[job]] for job in jobs)
            what = f"verify, {channels} channels, {amplifier}, {engine}, processor time"
            figures.append(in_seconds(what, spent, base, wanted))
            peaks.append(max(cost.memory for cost in found["verify"]))
    share = [peak / python("").memory for peak in peaks]
    what = "peak memory of the largest of these"
    figures.append(Figure(what, "memory of Python", share, MEMORY, max(peaks), "MB"))
    for topology, seconds in WIRED.items():
        channels = 3 if tiny else 128
        scene_of = wired(topology, channels).with_engine("statespace")
        spent, base = [processor(partial(verify, scene_of))()], [imports().processor]
        what = f"verify, {topology} with wires, {channels} channels, processor time"
        figures.append(in_seconds(what, spent, base, seconds))
    return figures


def wired(topology: str, channels: int) -> Scene:
    """Return a closed-loop board with wires, of conductances ``0.5^|i - j| G0``."""
    place = np.arange(channels)
    scene = Scene.from_arrays(
        0.5 ** np.abs(place[:, None] - place), np.where(place % 3 == 0, -0.05, 0.1),
        topology=topology, unit_conductance=1e-4, opamp="opa189",
    )  # fmt: skip
    lines = dict.fromkeys(("wires.word_line", "wires.bit_line"), 1.0)
    ends = dict.fromkeys(("wires.driver", "wires.sense"), 5.0)
    return with_values(scene, {**lines, **ends, "wires.compensate": True, **FEEDBACK[topology]})
