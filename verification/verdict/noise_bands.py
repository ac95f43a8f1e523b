"""Bands of frequencies in which a noise analysis follows every resonance of a board."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.analysis import Band
from taction.system.array_types import Complexes
from taction.system.errors import EngineError

STEP = 0.1  # of the distance to the nearest pole: step of the frequencies
BELOW, ABOVE = 1e-4, 1e4  # of the slowest, and of the fastest pole: first and last frequency
COARSEST = 20  # steps per decade; finer bands have this times a power of 2
MOST_STEPS = 20_000


def noise_bands(poles: Complexes) -> tuple[Band, ...]:
    """Return bands for the integral of a spectrum with these poles, 1/s.

    A spectrum changes over the distance from ``j 2 pi f`` to the nearest pole. With the defaults
    Simpson's rule errs by less than 1e-3 of the integral, and so does what lies outside the bands.

    Raises
    ------
    EngineError
        A resonance is so sharp that more than `MOST_STEPS` steps are needed.

    Examples
    --------
    >>> import numpy as np
    >>> bands = noise_bands(np.array([-1e3 + 1e6j, -1e3 - 1e6j]))
    >>> bands[0].density, max(band.density for band in bands)
    (20, 40960)
    """
    sizes = np.abs(poles) / math.tau
    f, last = BELOW * float(sizes.min()), ABOVE * float(sizes.max())
    bands, left = list[Band](), MOST_STEPS
    while f < last:
        density, steps, start = _density(f, poles), 0, f
        ratio = 10.0 ** (1.0 / density)
        while f < last and (steps == 0 or _density(f, poles) == density):
            f, steps, left = f * ratio, steps + 1, left - 1
            if left < 0 or ratio == 1.0:
                raise EngineError(f"the resonances need more than {MOST_STEPS} frequencies")
        band = Band(start, steps, density)
        bands.append(band)
        f = band.stop
    return tuple(bands)


def _density(f: float, poles: Complexes) -> int:
    """Return the steps per decade at a frequency, Hz."""
    distance = float(np.abs(1j * math.tau * f - poles).min())
    wanted = math.tau * f * math.log(10.0) / (STEP * distance)
    doublings = max(math.ceil(math.log2(wanted / COARSEST)), 0)
    return int(COARSEST * 2**doublings)
