"""The keys of a scene that the explorer changes, with the ranges of their sliders."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.keys import find_key, own_value
from taction.netlist_gen.scene.scene import Scene

CAPACITANCE, GAIN, LAMBDA = "design.capacitance", "design.gain", "design.lambda"
STRAY, VARIANCE = "design.stray_capacitance", "problem.noise.variance"
AROUND = {CAPACITANCE: 30.0, GAIN: 30.0, LAMBDA: 1000.0}  # times and divided by the scene's value
LEAST_STRAY, MOST_STRAY = 1e-14, 1e-10  # F
LEAST_NOISE, MOST_NOISE = 1e-8, 1.0  # variance, of the mean square of the strain
STEPS, DIGITS = 1000, 4  # places of a slider, and digits of their values
ZERO_PART = 0.04  # of a slider whose value may be zero: its lower end


@dataclass(frozen=True, slots=True)
class Control:
    """A key with a logarithmic slider.

    Attributes
    ----------
    path, unit : str
        The key, and its SI unit; empty for a plain number.
    symbol, name : str
        How the page calls it.
    low, high : float
        Ends of the slider, in `unit`.
    own : float
        The scene's value.
    has_zero : bool
        Whether the lower end of the slider is zero.
    """

    path: str
    unit: str
    symbol: str
    name: str
    low: float
    high: float
    own: float
    has_zero: bool = False

    def chosen(self, place: float) -> float:
        """Return the value that a hand means at a place: of four digits, or the scene's own."""
        if abs(place - self.place(self.own)) < 0.5 / STEPS:
            return self.own
        return float(f"{self.value(place):.{DIGITS}g}")

    def value(self, place: float) -> float:
        """Return the value at a place of the slider from 0 to 1.

        Examples
        --------
        >>> stray = Control("a", "F", "", "", 1e-14, 1e-10, 0.0, has_zero=True)
        >>> stray.value(0.0), stray.value(1.0), stray.place(stray.value(0.3))
        (0.0, 1e-10, 0.3)
        """
        start = ZERO_PART if self.has_zero else 0.0
        if place < start or (self.has_zero and place == 0.0):
            return 0.0
        share = min((place - start) / (1.0 - start), 1.0)
        return self.high if share == 1.0 else self.low * (self.high / self.low) ** share

    def place(self, value: float) -> float:
        """Return the place of a value on the slider, from 0 to 1; the nearest end outside of it."""
        if value <= 0.0:
            return 0.0
        start = ZERO_PART if self.has_zero else 0.0
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return round(start + (1.0 - start) * min(max(share, 0.0), 1.0), 12)


def controls(scene: Scene, problem: InverseProblem) -> tuple[Control, ...]:
    """Return the controls of a scene whose lambda is a number.

    Examples
    --------
    >>> from taction.netlist_gen.scene.inverse_problem import make_problem
    >>> from taction.netlist_gen.scene.scene import load_scene
    >>> scene = load_scene("scenes/paper-breadboard.toml")
    >>> [control.symbol for control in controls(scene, make_problem(scene))]
    ['C', 's', 'λ', 'stray', 'σ²']
    """
    own = {
        path: float(own_value(scene, find_key(scene, path)) or 0.0)
        for path in (CAPACITANCE, GAIN, LAMBDA, STRAY, VARIANCE)
    }
    around = {path: (own[path] / by, own[path] * by) for path, by in AROUND.items()}
    strain = float(np.mean(problem.strain**2)) or 1.0
    noise = LEAST_NOISE * strain, MOST_NOISE * strain
    return (
        Control(CAPACITANCE, "F", "C", "capacitance", *around[CAPACITANCE], own[CAPACITANCE]),
        Control(GAIN, "ohm", "s", "gain", *around[GAIN], own[GAIN]),
        Control(LAMBDA, "", "λ", "regularisation", *around[LAMBDA], own[LAMBDA]),
        _from_zero(STRAY, "F", "stray", "capacitance", LEAST_STRAY, MOST_STRAY, own[STRAY]),
        _from_zero(VARIANCE, "", "σ²", "noise variance", *noise, own[VARIANCE]),
    )


def _from_zero(
    path: str, unit: str, symbol: str, name: str, low: float, high: float, own: float
) -> Control:
    """Return a control whose lower end is zero, and whose range holds the scene's value."""
    if own > 0.0:
        low, high = min(low, own / 10.0), max(high, own * 10.0)
    return Control(path, unit, symbol, name, low, high, own, has_zero=True)
