"""Analyses as data; the deck writer and the engines read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

# An exponential board that starts from nothing with a larger first step can make the first
# iteration of an antilog stage overflow: one scene did at 250 points a period and at no other
# number of points; with this first step no scene did at any number that was tried.
FIRST_STEP = 1e-3  # of the maximum step


@dataclass(frozen=True, slots=True)
class SimulatorTolerances:
    """Tolerances of ngspice; they follow from the scene's scales, not from ngspice's defaults."""

    relative: float  # of Newton's iteration
    current: float  # absolute, A
    voltage: float  # absolute, V
    charge: float  # absolute, C
    gmin: float  # smallest pivot, S
    junction: float  # parallel conductance of junctions, S


@dataclass(frozen=True, slots=True)
class Transient:
    """A transient from t = 0."""

    stop: float  # end, s
    max_step: float  # largest step, s
    # largest relative error of one step; it bounds the step of a board too fast for `max_step`
    truncation: float = 1e-4
    # C below which that error counts absolutely; None: a charge far below every capacitor's
    charge: float | None = field(default=None, repr=False)
    # what the rounding of charges makes of currents over the shortest step, A: Newton's iteration
    # does not converge to less
    current: float = field(default=0.0, repr=False)
    first_step: float | None = field(default=None, repr=False)  # s; None: max_step / 1000
    # zero: every capacitor is discharged when the strain steps on; rest: as without strain
    initial: Literal["zero", "rest"] = "zero"
    method: Literal["trapezoidal", "gear"] = "trapezoidal"
    # initial node voltages, V, in the place of 0 V: they start a board along one of its modes
    voltages: Mapping[str, float] = field(default_factory=dict)

    @property
    def begin(self) -> float:
        """The first step, s."""
        return FIRST_STEP * self.max_step if self.first_step is None else self.first_step


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """The equilibrium with the strain applied."""


@dataclass(frozen=True, slots=True)
class NoiseBand:
    """Frequencies in geometric progression."""

    start: float  # the lowest, Hz
    steps: int
    density: int  # steps per decade

    @property
    def stop(self) -> float:
        """The highest, Hz."""
        return float(self.start * 10.0 ** (self.steps / self.density))


@dataclass(frozen=True, slots=True)
class NoiseAnalysis:
    """The noise at the equilibrium with the strain applied, over `bands` that follow each other."""

    bands: tuple[NoiseBand, ...]


Analysis = Transient | OperatingPoint | NoiseAnalysis


@dataclass(frozen=True, slots=True)
class SimulatedDeck:
    """The text of a deck, and what is asked of the simulator."""

    text: str = field(repr=False)  # the first line is a fixed title
    saved: tuple[str, ...]  # nodes whose voltages are saved, in this order
    analysis: Analysis
    files: Mapping[str, str] = field(default_factory=dict, repr=False)  # files beside it, by name
