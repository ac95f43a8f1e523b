"""Instants of a record with uniform spacing."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Floats


def record_times(analysis: Transient, end: float) -> Floats:
    """Return uniform instants up to `end`, s, with a spacing of at most `max_step`."""
    count = math.ceil(analysis.stop / analysis.max_step * (1.0 - 1e-12)) + 1
    times = np.linspace(0.0, analysis.stop, count)
    if end >= analysis.stop * (1.0 - 1e-9):
        return times
    return np.append(times[times < end], end)
