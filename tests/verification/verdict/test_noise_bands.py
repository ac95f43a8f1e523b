"""Bands of a noise analysis: they follow each other and the poles."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from taction.system.errors import EngineError
from taction.verification.verdict.output_noise import STEP, noise_bands

POLES = {
    "one pole": [-1e3 + 0j],
    "two poles": [-1.0 + 0j, -1e9 + 0j],
    "resonances": [-1e3 + 1e6j, -1e3 - 1e6j, -50.0 + 1.01e6j, -50.0 - 1.01e6j, -1e8 + 0j],
}


@pytest.mark.parametrize("name", POLES)
def test_every_step_is_a_part_of_the_distance_to_the_nearest_pole(name: str) -> None:
    poles = np.array(POLES[name])
    bands = noise_bands(poles)
    assert bands[0].start < 1e-3 * np.abs(poles).min() / math.tau
    assert bands[-1].stop > 1e3 * np.abs(poles).max() / math.tau
    for band, following in itertools.pairwise(bands):
        assert band.stop == pytest.approx(following.start, rel=1e-12)
    for band in bands:
        f = band.start * 10.0 ** (np.arange(band.steps) / band.density)
        distance = np.abs(1j * math.tau * f[:, None] - poles).min(axis=1)
        step = math.tau * f * math.log(10.0) / band.density
        assert (step <= (1.0 + 1e-9) * STEP * distance).all()


@pytest.mark.parametrize("damping", [1e-6, 1e-12])
def test_resonances_without_end_are_refused(damping: float) -> None:
    """By their number, and by a step that no float has."""
    centres = 1e6 + np.arange(200.0) if damping == 1e-6 else np.array([1e6])
    poles = np.concatenate([-damping + 1j * centres, -damping - 1j * centres])
    with pytest.raises(EngineError, match="more than 20000 frequencies"):
        noise_bands(poles)
