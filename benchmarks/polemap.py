"""A map of rightmost poles over C and gain: by the state-space engine, by ngspice transients."""

from __future__ import annotations

import math
import random
import time
from dataclasses import dataclass

import numpy as np
from boards import Setting, make_board, run_ngspice, shipped

from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_values
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import Scene
from spice_models.errors import EngineError, SimulationError
from verification.measures.mode_fit import fit_modes
from verification.small_signal.poles import poles

SPANS = {"design.capacitance": (2e-12, 50e-12), "design.gain": (1e6, 20e6)}  # F, ohm
POINTS = (16.0, 25.0, 35.0, 50.0, 70.0, 100.0)  # on a ringing period, for ngspice to choose from
PLANNED = 125.0  # what `taction verify` takes for a scene that does not say
GROWTH, FREQUENCY = 0.05, 0.01  # relative differences of a fitted pole that is right
TIMEOUT = 20.0  # s that a transient may take; one that takes longer counts as so long


@dataclass(frozen=True)
class MapTimes:
    """What a map costs.

    Attributes
    ----------
    points : int
        Of the whole map.
    seconds : float
        Of the state-space engine for all of them, s.
    sample : list of float
        Of ngspice for some of them, s.
    right : int
        Of the sample, how many records showed the rightmost pole, within `GROWTH` and `FREQUENCY`.
    setting : Setting
        The coarsest with which ngspice finds the rightmost pole of the scene itself.
    planned : list of float
        Of ngspice for the same sample with `PLANNED` points on a period, s.
    """

    points: int
    seconds: float
    sample: list[float]
    right: int
    setting: Setting
    planned: list[float]


def grid(side: int) -> list[dict[str, float]]:
    """Return the points of the map, logarithmic."""
    first, second = (np.geomspace(*span, side).tolist() for span in SPANS.values())
    return [dict(zip(SPANS, (a, b), strict=True)) for a in first for b in second]


def time_map(side: int, samples: int) -> MapTimes:
    """Map `side` by `side` points, and time ngspice on a random sample of them."""
    scene = shipped("paper-breadboard").scene
    values = grid(side)
    rightmost(scene)  # what is imported on first use
    began = time.perf_counter()
    for point in values:
        rightmost(with_values(scene, point))
    seconds = time.perf_counter() - began
    settings = [Setting("even", count, "klu") for count in POINTS]
    setting = next((s for s in settings[:-1] if transient(scene, s)[1]), settings[-1])
    chosen = random.Random(1993).sample(values, samples)  # noqa: S311 - no secret
    scenes = [with_values(scene, point) for point in chosen]
    found = [transient(each, setting) for each in scenes]
    planned = [transient(each, Setting("even", PLANNED, "klu"))[0] for each in scenes]
    right = sum(shown for _, shown in found)
    return MapTimes(len(values), seconds, [s for s, _ in found], right, setting, planned)


def rightmost(scene: Scene) -> complex:
    """Return the rightmost pole of a scene's board, 1/s."""
    return poles(synthesise(scene, make_problem(scene))).rightmost


def transient(scene: Scene, setting: Setting) -> tuple[float, bool]:
    """Run ngspice to the scene's own stop time: s, and whether the rightmost pole shows in it."""
    try:
        board = make_board(scene)
        found = run_ngspice(board, setting, TIMEOUT)
    except (EngineError, SimulationError):
        return TIMEOUT, False
    pole = poles(board.circuit).rightmost
    fitted = [
        complex(mode.growth_rate, 2.0 * math.pi * mode.frequency)
        for mode in fit_modes(np.array(found.time), np.array(found.values))
    ]
    return found.cost.seconds, any(_right(p, pole) for p in fitted)


def _right(found: complex, pole: complex) -> bool:
    """Whether a fitted pole agrees with the pole in growth rate and frequency."""
    growth, frequency = abs(found.real - pole.real), abs(found.imag - pole.imag)
    return growth <= GROWTH * abs(pole.real) and frequency <= FREQUENCY * abs(pole.imag)
