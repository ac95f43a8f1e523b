"""What the engines know of each behavioural amplifier: ``g``, its slope, and a safe coordinate.

One entry of `GAINS` a kind of `spice_models.amplifier.AMPLIFIERS` (any but the linear one, which
is an op-amp). The safe coordinate of a channel is ``q = y + h g(y)`` with ``h >= 0``: where the
feedback is strong it is nearly the amplifier's output, where it is weak nearly its input, so a
Newton step in q neither overflows nor crawls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spice_models.errors import EngineError

Floats = NDArray[np.float64]

LARGEST_EXPONENT = 690.0  # exp(690) is near 1e300: room for a gain, none for an overflow


@dataclass(frozen=True, slots=True)
class Gain:
    """An increasing function g of the dimensionless input ``y = v / v_scale``.

    Attributes
    ----------
    value, slope : callable
        g and g' of an array.
    from_coordinate : callable
        ``(q, h) -> y`` with ``y + h g(y) = q``.
    upper : float
        Largest y at which g is representable.
    """

    value: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]
    from_coordinate: Callable[[Floats, Floats], Floats]
    upper: float


def _exponential_from_coordinate(q: Floats, h: Floats) -> Floats:
    """Solve ``y + h exp(y) = q`` by the Wright omega function, free of cancellation."""
    from scipy.special import wrightomega

    log_h = np.log(h)
    omega = wrightomega(q + log_h)
    large = omega > 1.0
    return np.where(large, np.log(np.where(large, omega, 1.0)) - log_h, q - omega)


GAINS: dict[str, Gain] = {
    "exponential": Gain(np.exp, np.exp, _exponential_from_coordinate, LARGEST_EXPONENT),
}


def gain_of(kind: str) -> Gain:
    """Return the entry of `GAINS`.

    Raises
    ------
    EngineError
        The kind has no entry.
    """
    if kind not in GAINS:
        known = ", ".join(sorted(GAINS))
        message = f"the state-space engine has no amplifier kind {kind!r}; it knows {known}"
        raise EngineError(message)
    return GAINS[kind]
