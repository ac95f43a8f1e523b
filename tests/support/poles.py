"""Poles that a test states."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import EPS, Complexes
from taction.verification.stability.poles import Poles, summarise


def rounded_poles(values: Complexes) -> Poles:
    """Return all poles of a board, known to 64 units of rounding of the fastest."""
    error = 64.0 * EPS * float(np.abs(values).max(initial=0.0))
    return summarise(values, complete=True, errors=np.full(len(values), error))
