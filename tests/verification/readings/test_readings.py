"""Overshoot and undershoot by their definition, on signals with a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.readings.readings import STILL, Reading, Step, excursions, largest
from taction.verification.readings.signals import SampledSignal

TIME = np.linspace(0.0, 20.0, 2001)


def swings(*channels: tuple[float, float, float]) -> tuple[SampledSignal, Step]:
    """Channels ``(start, target, swing)``: a monotone step plus ``swing (exp(-t) - exp(-2 t))``."""
    start, target, swing = np.array(channels).T[:, :, None]
    there = 1.0 - np.exp(-10.0 * TIME)
    u = start + (target - start) * there + 4.0 * swing * (np.exp(-TIME) - np.exp(-2.0 * TIME))
    return SampledSignal(TIME, u - target), Step(start[:, 0], target[:, 0])


def read(*channels: tuple[float, float, float]) -> tuple[list[float], list[float]]:
    over, under = excursions(*swings(*channels)).values()
    return [found.value for found in over], [found.value for found in under]


def bounds(signal: SampledSignal, step: Step) -> list[list[float]]:
    return [[found.uncertainty for found in kind] for kind in excursions(signal, step).values()]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("offset", [0.0, 3.0])
def test_each_excursion_has_its_own_side(sign: float, offset: float) -> None:
    """A swing beyond the target is overshoot, a swing beyond the start undershoot."""
    big = (offset, offset + sign, 0.0)  # the network's step is 1
    level, away = offset + 0.5 * sign, -0.8 * sign
    over, under = read(big, (offset, level, 0.5 * sign), (offset, level, away))
    assert max(over[0], under[0]) < 1e-15
    assert over[1] == pytest.approx(0.5, abs=1e-3)  # the step is over at the peak
    assert max(under[1], over[2]) < 1e-15
    assert under[2] == pytest.approx(0.3, abs=1e-2)


@pytest.mark.parametrize("size", [0.04, -0.04])
@pytest.mark.parametrize("swing", [0.3, -0.3])
def test_a_small_step_overshoots_on_either_side_of_its_interval(size: float, swing: float) -> None:
    over, under = read((0.0, 1.0, 0.0), (0.0, size, swing))
    ahead = np.sign(size) == np.sign(swing)
    beyond = 0.3 if ahead else 0.3 - abs(size)  # of the target, of the start
    assert over[1] == pytest.approx(beyond, abs=1e-3)
    assert under[1] == pytest.approx(0.0 if ahead else over[1], abs=1e-3)


def test_the_sign_of_a_step_that_is_rounding_decides_nothing() -> None:
    for swing in (0.3, -0.3):
        found = [
            read((0.0, 1.0, 0.0), (0.0, size, swing)) for size in (0.0, 0.5 * STILL, -0.5 * STILL)
        ]
        for over, under in found:
            assert over[1] == pytest.approx(0.3, abs=1e-4)
            assert under[1] == pytest.approx(0.3, abs=1e-4)


def test_every_channel_has_bounds_of_its_own() -> None:
    """Each bound is that of the channel's samples; an excursion of 0 is uncertain upwards only."""
    signal, step = swings((0.0, 1.0, 0.0), (0.0, 0.5, 0.5), (0.0, 0.5, -0.8))
    known = SampledSignal(signal.time, signal.errors, error=0.01)
    over, under = bounds(known, step)
    assert 0.0 < over[0] <= 0.01 * (1.0 + 1e-9)
    assert over[1] == pytest.approx(0.01, rel=1e-3)
    assert under[2] == pytest.approx(0.01, rel=1e-3)
    exact, _ = bounds(signal, step)
    assert all(0.0 < bound < 1e-4 for bound in exact)


def test_an_error_without_a_bound_leaves_the_value() -> None:
    signal, step = swings((0.0, 1.0, 0.3))
    blurred = SampledSignal(signal.time, signal.errors, error=np.inf)
    over = excursions(blurred, step)["overshoot"][0]
    assert over.value == pytest.approx(0.3, abs=1e-3)
    assert over.uncertainty == np.inf


def test_the_largest_value_may_be_that_of_an_uncertain_channel() -> None:
    both = [largest([Reading(0.3, 0.01), Reading(0.2, error)]) for error in (0.15, 0.0)]
    assert [found.value for found in both] == [0.3, 0.3]
    assert [found.uncertainty for found in both] == [pytest.approx(0.05), pytest.approx(0.01)]


def test_without_a_step_there_is_no_excursion() -> None:
    assert read((1.0, 1.0, 0.3), (0.0, 0.0, 0.1)) == ([0.0, 0.0], [0.0, 0.0])
