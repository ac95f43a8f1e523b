"""Instants of a record, and the bound above which it ends."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Floats

ESCAPED = 1e8  # of the board's largest voltage: a board above it has diverged, and the record ends


def record_times(analysis: Transient, end: float, times: Floats | None = None) -> Floats:
    """Return the instants `times` (P,) up to `end`, s; by default a step of at most `max_step`."""
    if times is None:
        count = math.ceil(analysis.stop / analysis.max_step * (1.0 - 1e-12)) + 1
        times = np.linspace(0.0, analysis.stop, count)
    if end >= times[-1] * (1.0 - 1e-9):
        return times
    return np.append(times[times < end], end)
