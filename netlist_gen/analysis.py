"""Analyses as data; the deck writer and the engines read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of ngspice; they follow from the scene's scales, not from ngspice's defaults."""

    relative: float  # of Newton's iteration
    current: float  # absolute, A
    voltage: float  # absolute, V
    charge: float  # absolute, C
    gmin: float  # parallel conductance and smallest pivot, S


@dataclass(frozen=True, slots=True)
class Transient:
    """A transient from t = 0.

    Attributes
    ----------
    stop, max_step : float
        End and largest step, s.
    truncation : float
        Largest relative truncation error of one step; it bounds the step where the board is too
        fast for `max_step`.
    initial : str
        ``"zero"``: every capacitor is discharged when the strain steps on. ``"rest"``: the
        equilibrium without strain.
    method : str
        Integration method.
    voltages : dict of str to float
        Initial node voltages, V, in the place of 0 V for ``"zero"``; they start a board along one
        of its modes.
    """

    stop: float
    max_step: float
    truncation: float = 1e-4
    initial: Literal["zero", "rest"] = "zero"
    method: Literal["trapezoidal", "gear"] = "trapezoidal"
    voltages: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """The equilibrium with the strain applied."""


Analysis = Transient | OperatingPoint
