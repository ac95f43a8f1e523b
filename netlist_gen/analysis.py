"""Analyses as small data types; the deck writer and the engines read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class Tolerances:
    """What ngspice is told to achieve; chosen from the scene's own scales, never its defaults.

    Attributes
    ----------
    relative : float
        Of Newton's iteration.
    current, voltage, charge : float
        Absolute, A, V and C.
    gmin : float
        Parallel conductance and least pivot, S.
    """

    relative: float
    current: float
    voltage: float
    charge: float
    gmin: float


@dataclass(frozen=True, slots=True)
class Transient:
    """A transient from t = 0.

    Attributes
    ----------
    stop, max_step : float
        End and largest step, s.
    truncation : float
        Local error that one step may make, relative: what bounds the step where the board is
        faster than `max_step` provides for.
    initial : str
        ``"zero"``: every capacitor is discharged when the strain steps on. ``"rest"``: the
        equilibrium without strain.
    method : str
        Integration method.
    voltages : dict of str to float
        Initial node voltages in V that replace zeros of ``"zero"``; they start a board along one
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
