"""How long and how finely, from the poles of a board."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from netlist_gen.scene.scene import Scene
from spice_models.errors import EngineError, InputError
from tests.support.making import make_scene
from verification.pipeline.transient_plan import MAX_POINTS, coarser, plan_transient
from verification.small_signal.time_scales import Ringing, TimeScales


def scales(pole: complex, *, growth: float = math.inf, amplitude: float = 1.0) -> TimeScales:
    """One pair of poles, or one real pole, with an amplitude in step amplitudes."""
    poles = np.array([pole, pole.conjugate()] if pole.imag else [pole])
    share = amplitude / len(poles)
    period = 2 * math.pi / abs(pole.imag) if pole.imag else math.inf
    ringing = (Ringing(1 / period, period, -1 / pole.real, amplitude),) if pole.imag else ()
    return TimeScales(
        poles=poles.astype(complex),
        amplitudes=np.full(len(poles), share),
        slowest=-1 / pole.real,
        ringing=ringing,
        growth_time=growth,
        stop=0.0,
        max_step=0.0,
    )


NOTHING = TimeScales(np.zeros(0, complex), np.zeros(0), 0.0, (), math.inf, 0.0, 0.0)


def scene(**analysis: Any) -> Scene:
    return make_scene(analysis={"points_per_period": 100, **analysis})


def test_the_stop_time_follows_the_slowest_mode() -> None:
    """exp(-t/tau) falls to a tenth of 1e-3 at 9.21 tau; a fifth more shows that it stays."""
    found = plan_transient(scene(), scales(-1e4 + 1e5j))
    assert found.stop == pytest.approx(1.2 * math.log(1e4) * 1e-4, rel=1e-5)
    assert found.max_step == pytest.approx(2 * math.pi * 1e-5 / 100, rel=1e-5)


def test_it_shows_eight_periods_at_least() -> None:
    found = plan_transient(scene(), scales(-1e5 + 1e5j))
    assert found.stop == pytest.approx(8 * 2 * math.pi * 1e-5, rel=1e-5)


def test_an_unstable_board_gets_the_time_to_show_it() -> None:
    assert plan_transient(scene(), scales(1e3 + 1e5j, growth=5e-3)).stop == 5e-3


def test_the_times_of_the_scene_are_kept() -> None:
    found = plan_transient(scene(stop=1 / 300, initial="rest"), scales(-1e4 + 1e5j))
    assert found.stop == 1 / 300
    assert found.initial == "rest"
    assert found.truncation == pytest.approx((2 * math.pi / 100) ** 3 / 6)


def test_a_rounded_time_does_not_depend_on_the_last_digit_of_a_pole() -> None:
    one = plan_transient(scene(), scales(-1.1e4 + 1.3e5j))
    other = plan_transient(scene(), scales(-1.1e4 * (1 + 1e-13) + 1.3e5j * (1 - 1e-13)))
    assert (one.stop, one.max_step) == (other.stop, other.max_step)


def test_what_cannot_be_planned_is_refused() -> None:
    with pytest.raises(InputError, match="shorter than 50 time steps"):
        plan_transient(scene(stop=1e-6), scales(-1e4 + 1e5j))
    with pytest.raises(EngineError, match="edge of oscillation"):
        plan_transient(scene(), scales(-1e-2 + 1e6j))
    with pytest.raises(EngineError, match="nothing to time"):
        plan_transient(scene(), NOTHING)


def test_the_points_are_bounded() -> None:
    found = plan_transient(scene(stop=1.0), scales(-1e4 + 2e4j))
    assert found.stop / found.max_step <= MAX_POINTS


def test_a_coarser_run_is_coarser_everywhere() -> None:
    fine = plan_transient(scene(), scales(-1e4 + 1e5j))
    twice = coarser(fine, 2.0)
    assert twice.max_step == 2 * fine.max_step
    assert twice.truncation == 8 * fine.truncation
    assert twice.stop == fine.stop
