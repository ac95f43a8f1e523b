"""Values that can be bought, or written with three digits, in an interval."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.board.preferred_values import mantissas, nearest
from taction.netlist_gen.scene.design import Design
from taction.system.array_types import Floats

DIGITS = 3  # of a value without a series
SLACK = 1e-9  # relative: an end of an interval belongs to it


def series_of(design: Design, path: str) -> str:
    """Return the series of the values of a key: that of the scene, or ``"exact"``."""
    if path == "design.capacitance":
        return design.capacitor_series
    return design.resistor_series if path in RESISTORS else "exact"


RESISTORS = ("design.resistance", "design.gain", "design.inverter_resistance")


def values_between(low: float, high: float, series: str) -> Floats:
    """Return the values of a series from `low` to `high`, increasing, (P,).

    ``"exact"`` stands for all numbers of three digits.

    Examples
    --------
    >>> values_between(1e-11, 2.2e-11, "E6").tolist()
    [1e-11, 1.5e-11, 2.2e-11]
    >>> len(values_between(1.0, 10.0, "exact"))
    901
    """
    first, last = math.floor(math.log10(low)), math.floor(math.log10(high))
    if series == "exact":
        steps = np.arange(10 ** (DIGITS - 1), 10**DIGITS) / 10.0 ** (DIGITS - 1)
    else:
        steps = mantissas(series)
    texts = [f"{step!r}e{k}" for k in range(first, last + 1) for step in steps.tolist()]
    values = np.array([float(text) for text in texts])
    return values[(values >= low * (1.0 - SLACK)) & (values <= high * (1.0 + SLACK))]


def buyable(value: float, series: str) -> float:
    """Return the nearest value of a series, or the value with three digits.

    Examples
    --------
    >>> buyable(1.2345e6, "exact"), buyable(1.2345e6, "E24")
    (1230000.0, 1200000.0)
    """
    if series == "exact":
        return float(f"{value:.{DIGITS - 1}e}")
    return float(nearest(np.array([value]), series)[0])
