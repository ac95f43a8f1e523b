"""Limits of a fresh scene that its own boards keep: they follow from the resistors.

Resistors within their tolerance move the outputs at rest. To first order the error of channel n is
Gaussian with ``sigma_n² = sum_p (dy_n/dp)² / 9``, since a tolerance is three sigma. The limit is
above the error that one of N channels exceeds in 2 % of the boards.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.verification.studies.tolerance.rest_slopes import rest_slopes
from taction.verification.studies.tolerance.varied_board import VariedBoard, prepare

GRADES = (0.01, 1e-3, 1e-4)  # tolerances of resistors that are sold, the cheapest first
WANTED = 0.02  # a better grade is taken where the limit would be above this share of the step
BEYOND = 0.02  # share of the boards with a channel beyond the limit
ROUND = (1.0, 2.0, 5.0, 10.0)
LEAST = 1e-3  # the default limit
BAND = 2.0  # the settling band over the limit


def with_limits(scene: Scene) -> tuple[Scene, str]:
    """Return the scene with limits that 98 % of its boards keep at rest, and how they were chosen.

    Raises
    ------
    InputError, NoVerdictError
        The board cannot be built, or has no equilibrium.
    """
    for grade in GRADES:
        changed = with_values(scene, {"tolerances.resistor": grade})
        share = exceeded(prepare(changed), BEYOND)
        if share <= WANTED:
            break
    limit = max(LEAST, rounded_up(share))
    keys = {"checks.steady_state.tolerance": limit, "checks.settling_time.band": BAND * limit}
    note = (
        f"resistors of {100 * grade:g} % move the outputs at rest by up to {100 * share:.2g} % of"
        f" the step in 98 % of the boards: the limit is {100 * limit:g} %"
    )
    return with_values(changed, keys), note


def exceeded(board: VariedBoard, beyond: float) -> float:
    """Return the error at rest that a share of the boards exceeds in a channel, in steps."""
    slopes = rest_slopes(board)
    sigma = np.sqrt((slopes**2).sum(axis=0)) / 3.0
    quantile = NormalDist().inv_cdf(1.0 - beyond / (2.0 * slopes.shape[1]))
    share = quantile * float(sigma.max(initial=0.0)) / board.step_amplitude
    return share if math.isfinite(share) else 0.0  # without a step nothing is judged


def rounded_up(value: float) -> float:
    """Return the next number of 1, 2, 5 and 10 times a power of ten.

    Examples
    --------
    >>> rounded_up(0.0123)
    0.02
    """
    decade = 10.0 ** math.floor(math.log10(value)) if value > 0.0 else 0.0
    return next((float(f"{m * decade:.1g}") for m in ROUND if m * decade >= value), 0.0)
