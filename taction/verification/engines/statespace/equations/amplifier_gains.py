"""The function ``g``, its slope and a safe coordinate for each kind of behavioural amplifier.

`GAINS` has one entry for each kind of `spice_models.amplifier.AMPLIFIERS` except the linear one,
which is an op-amp, and the `OPAMP_KINDS`: input stage, swing and output current of an op-amp with
limits (`taction.spice_models.opamp`). The safe
coordinate of a channel is ``q = y + h g(y)`` with ``h >= 0``. With strong feedback q is close to
the amplifier's output, with weak feedback to its input, so a Newton step in q neither overflows nor
becomes too short.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from taction.spice_models.opamp import KNEE
from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.system.plugins import OpenTable

OPAMP_KINDS = INPUT_STAGE, CLAMP, LIMITER = ("stage", "clamp", "limiter")
HUGE = 1e300
NEWTON_STEPS = 200  # enough for bisection alone
LARGEST_EXPONENT = 690.0  # exp(690) is near 1e300: a gain still fits without overflow


@dataclass(frozen=True, slots=True)
class Gain:
    """An increasing function g of the dimensionless input ``y = v / v_scale``.

    `value` and `slope` are g and g' of an array; `upper` is the largest y at which g is
    representable. `breaks` are where the straight pieces of a piecewise linear g meet, increasing,
    and None for any other g; there the slope is that of the piece to the right.
    """

    value: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]
    upper: float
    breaks: tuple[float, ...] | None = None

    def outputs(self, y: Floats) -> Floats:
        """Return g(y); not finite where y is above `upper`."""
        with np.errstate(over="ignore"):
            return self.value(np.where(y > self.upper, np.inf, y))

    def from_coordinate(self, q: Floats, h: Floats) -> Floats:
        """Return the y with ``y + h g(y) = q``, by Newton's method inside a bracket of the root.

        The left side increases with a slope of at least 1, so the root lies between 0 and
        ``q - h g(0)``. A step that leaves the bracket, or that follows a step that reduced the
        residual to no less than a tenth, is replaced by the middle of the bracket. A bracket of
        neighbouring floats is an end, too: rounding of a limit's g may hide the root in it.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            far = q - h * self.value(np.zeros_like(q))
            low, high = np.minimum(far, 0.0), np.maximum(far, 0.0)
            y, before = np.zeros_like(q), np.full_like(q, np.inf)
            for _ in range(NEWTON_STEPS):
                curved = h * self.value(y)
                excess = y + curved - q
                done = np.abs(excess) <= EPS * (np.abs(y) + np.abs(curved) + np.abs(q))
                done |= high - low <= EPS * np.abs(y)
                done &= np.isfinite(curved)
                if np.all(done):
                    break
                low, high = np.where(excess <= 0, y, low), np.where(excess >= 0, y, high)
                step = y - excess / (1.0 + h * self.slope(y))
                # On a steep exponential, Newton's step is 1 at any distance from the root.
                good = (step >= low) & (step <= high) & (np.abs(excess) <= 0.1 * before)
                before = np.abs(excess)
                y = np.where(good | done, step, 0.5 * (low + high))
        return y

    @property
    def steepest(self) -> float:
        """Largest slope of the straight pieces; 0 of a g that has none."""
        if self.breaks is None:
            return 0.0
        return float(self.slope(np.array([self.breaks[0] - 1.0, *self.breaks])).max())


def _softplus(y: Floats) -> Floats:
    return np.maximum(y, 0.0) + np.log1p(np.exp(-np.abs(y)))


def _sigmoid(y: Floats) -> Floats:
    small = np.exp(-np.abs(y))
    return np.where(y >= 0, 1.0, small) / (1.0 + small)


def _sech2(y: Floats) -> Floats:
    small = np.exp(-2.0 * np.abs(y))
    return 4.0 * small / (1.0 + small) ** 2


def _clamped(y: Floats) -> Floats:
    """Return ``tanh(y - KNEE) + tanh(y + KNEE)`` without the cancellation of the two."""
    size = np.abs(y)
    far = (1.0 + np.exp(2.0 * (KNEE - size))) * (1.0 + np.exp(-2.0 * (KNEE + size)))
    return np.asarray(np.sign(y) * -2.0 * np.expm1(-4.0 * size) / far)


def _clamp_slope(y: Floats) -> Floats:
    return _sech2(y - KNEE) + _sech2(y + KNEE)


def _beyond(y: Floats) -> Floats:
    """Return nearly 0 between -1 and 1, and what y is beyond, with knees of ``1 / 2 KNEE``."""
    K = 2.0 * KNEE
    return (_softplus(K * (y - 1.0)) - _softplus(-K * (y + 1.0))) / K


def _beyond_slope(y: Floats) -> Floats:
    K = 2.0 * KNEE
    return _sigmoid(K * (y - 1.0)) + _sigmoid(-K * (y + 1.0))


def _within_one(y: Floats) -> Floats:
    return np.where((y >= -1.0) & (y < 1.0), 1.0, 0.0)


GAINS: Mapping[str, Gain] = OpenTable(
    "taction.amplifiers",
    {
        "exponential": Gain(np.exp, np.exp, LARGEST_EXPONENT),
        "sinh": Gain(np.sinh, np.cosh, LARGEST_EXPONENT),
        "softplus": Gain(_softplus, _sigmoid, HUGE),
        "tanh": Gain(np.tanh, _sech2, HUGE),
        "stage": Gain(np.tanh, _sech2, HUGE),
        "clamp": Gain(_clamped, _clamp_slope, HUGE),
        "deadzone": Gain(
            lambda y: y - np.clip(y, -1.0, 1.0),
            lambda y: np.asarray(1.0 - _within_one(y)),
            HUGE,
            (-1.0, 1.0),
        ),
        "rectifier": Gain(
            lambda y: np.maximum(y, 0.0), lambda y: np.where(y >= 0.0, 1.0, 0.0), HUGE, (0.0,)
        ),
        "saturation": Gain(lambda y: np.clip(y, -1.0, 1.0), _within_one, HUGE, (-1.0, 1.0)),
        "limiter": Gain(_beyond, _beyond_slope, HUGE),
    },
    Gain,
    part="gain",
)
"""The functions by kind, with those of other packages."""


@functools.cache
def gain_of(kinds: tuple[str, ...]) -> Gain:
    """Return the functions of m amplifiers of some kinds, for arrays of m rows.

    Amplifiers of one kind, also of any number, have the entry of `GAINS`.

    EngineError: an unknown kind.
    """
    for kind in kinds:
        if kind not in GAINS:
            known = ", ".join(sorted(GAINS))
            message = f"the state-space engine has no amplifier kind {kind!r}, only {known}"
            raise EngineError(message)
    several = sorted(set(kinds))
    if len(several) <= 1:
        return GAINS[several[0] if several else "tanh"]
    rows = [(GAINS[kind], np.flatnonzero(np.array(kinds) == kind)) for kind in several]

    def joined(name: str) -> Callable[[Floats], Floats]:
        def function(y: Floats) -> Floats:
            values = np.empty(y.shape)
            for gain, row in rows:
                values[row] = getattr(gain, name)(y[row])
            return values

        return function

    upper = min(gain.upper for gain, _ in rows)
    return Gain(joined("value"), joined("slope"), upper)
