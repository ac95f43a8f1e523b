"""Analyses as small data types; the deck writer and the engines read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class Tolerances:
    """ngspice's tolerances: relative, current (A), voltage (V), charge (C) and the parallel
    conductance gmin (S). Chosen from the scene's own scales, never ngspice's defaults.
    """  # noqa: D205

    relative: float
    current: float
    voltage: float
    charge: float
    gmin: float


@dataclass(frozen=True, slots=True)
class Transient:
    """A transient from t = 0 to `stop` with no step above `max_step` (both s).

    `initial` is ``"zero"`` (every capacitor discharged when the strain steps on) or ``"rest"``
    (the equilibrium without strain). `voltages` are initial node voltages in V that replace the
    zeros of ``"zero"`` (used to start a board along one of its modes).
    """

    stop: float
    max_step: float
    initial: Literal["zero", "rest"] = "zero"
    method: Literal["trapezoidal", "gear"] = "trapezoidal"
    voltages: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """The equilibrium with the strain applied."""


Analysis = Transient | OperatingPoint
