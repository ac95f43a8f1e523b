"""Preferred values of parts (IEC 60063), and values that can be bought in an interval."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from taction.netlist_gen.scene.design import Design
from taction.system.array_types import Floats

DIGITS = 3  # of a value without a series
SLACK = 1e-9  # relative: an end of an interval belongs to it
_E24 = (
    *(1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0),
    *(3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1),
)


@lru_cache
def mantissas(series: str) -> Floats:
    """Return the values of one decade, from 1 to below 10; read-only.

    E6 and E12 hold every fourth and every second value of E24. E192 holds 9.20 as the standard has
    it; ``10^(185/192)`` rounds to 9.19.
    """
    count = int(series[1:])
    if count <= len(_E24):
        values = np.array(_E24[:: len(_E24) // count])
    else:
        values = np.round(10.0 ** (np.arange(count) / count), 2)
        values[np.isclose(values, 9.19)] = 9.20
    values.flags.writeable = False
    return values


def nearest(values: Floats, series: str) -> Floats:
    """Return the nearest preferred values by ratio (any shape, infinite stays infinite).

    ``"exact"`` returns `values`, ohm or F, unchanged.
    """
    if series == "exact":
        return values
    steps = np.append(mantissas(series), 10.0)
    finite = np.isfinite(values)
    decade = np.floor(np.log10(values, where=finite, out=np.zeros_like(values)))
    mantissa = np.where(finite, values / 10.0**decade, 1.0)
    place = np.clip(np.searchsorted(steps, mantissa), 1, len(steps) - 1)
    lower, upper = steps[place - 1], steps[place]
    chosen = np.where(mantissa * mantissa < lower * upper, lower, upper)
    digits = np.round(chosen * 100.0)  # three digits: exact, so that 4.7k is 4700.0
    shift = decade - 2
    value = np.where(shift >= 0, digits * 10.0 ** np.abs(shift), digits / 10.0 ** np.abs(shift))
    return np.where(finite, value, values)


@lru_cache(maxsize=4096)
def preferred(ohms: float, series: str) -> float:
    """Return the value of a series that is nearest to `ohms`; see `nearest`.

    The boards of a study have most of their resistors in common.
    """
    return ohms if series == "exact" else float(nearest(np.array([ohms]), series)[0])


def series_of(design: Design, path: str) -> str:
    """Return the series of the values of a key: that of the scene, or ``"exact"``."""
    if path == "design.capacitance":
        return design.capacitor_series
    return design.resistor_series if path in RESISTORS else "exact"


RESISTORS = ("design.resistance", "design.gain", "design.inverter_resistance")


def values_between(low: float, high: float, series: str) -> Floats:
    """Return the values of a series from `low` to `high`, increasing, (P,).

    ``"exact"`` stands for all numbers of three digits.
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
    """Return the nearest value of a series, or the value with three digits."""
    if series == "exact":
        return float(f"{value:.{DIGITS - 1}e}")
    return float(nearest(np.array([value]), series)[0])
