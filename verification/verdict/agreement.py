"""Comparison of the state-space engine with ngspice over all time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.verdict.companion import Companion


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Differences of the outputs of two engines.

    Attributes
    ----------
    difference : float
        Largest difference of any output at any instant, V; NaN without a second solution.
    doubt : float
        Bound of the error of the state-space engine, V.
    step_error : float
        Expected error of the time steps of ngspice, V.
    limit : float
        Largest accepted difference, fraction of the step amplitude; without a step, of `unit`.
    unit : float
        Unit voltage U0, V.
    time : float
        Instant of the largest difference, s.
    channel : int
        Channel of the largest difference, from 0.
    instants, differences : ndarray (Q,) and (Q, N)
        The differences over time, s and V.
    reason : str
        Why there is no second solution, or empty.
    """

    difference: float
    doubt: float
    step_error: float
    limit: float
    unit: float
    time: float
    channel: int
    instants: Floats
    differences: Floats
    reason: str


def compare_engines(
    companion: Companion, step_error: float, limit: float, unit: float
) -> Agreement:
    """Compare the outputs of ngspice with those of the state-space engine.

    Parameters
    ----------
    step_error : float
        Expected error of the time steps of ngspice, V.
    limit, unit : float
        See `Agreement`.
    """
    difference = companion.u - companion.other
    place, channel = np.unravel_index(int(np.argmax(np.abs(difference))), difference.shape)
    known = not companion.reason
    return Agreement(
        difference=float(abs(difference[place, channel])) if known else np.nan,
        doubt=companion.doubt,
        step_error=step_error,
        limit=limit,
        unit=unit,
        time=float(companion.instants[place]),
        channel=int(channel),
        instants=companion.instants,
        differences=difference if known else np.full_like(difference, np.nan),
        reason=companion.reason,
    )
