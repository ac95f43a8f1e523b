"""Op-amp figures: their limits, and the pole solve against mpmath and against itself."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.spice_models.opamp import (
    OpAmp,
    phase_margin,
    poles_from_phase_margin,
    second_pole_from_phase_margin,
    unity_gain_bandwidth,
)

gains = st.floats(3.0, 1e8)
frequencies = st.floats(1.0, 1e10)
within = st.floats(0.02, 0.98)


def possible_margin(gain: float, part: float) -> float:
    """A phase margin, degrees, between that of a double pole and that of a single one."""
    least = math.degrees(math.acos(1.0 - 2.0 / gain))
    most = math.degrees(math.acos(-1.0 / gain))
    return least + part * (most - least)


@given(gains, frequencies, within)
def test_poles_give_back_bandwidth_and_margin(gain: float, f_u: float, part: float) -> None:
    margin = possible_margin(gain, part)
    gbw, second = poles_from_phase_margin(gain, f_u, margin)
    model = OpAmp("x", gain, gbw, second)
    assert model.first_pole <= second
    assert unity_gain_bandwidth(model) == pytest.approx(f_u, rel=1e-9)
    assert phase_margin(model) == pytest.approx(margin, abs=1e-6)
    assert second_pole_from_phase_margin(gain, gbw, margin) == pytest.approx(second, rel=1e-12)


@pytest.mark.parametrize(
    ("model", "f_u", "margin"),
    [
        (OpAmp("x", 10.0, gbw=1e6), 1e5 * math.sqrt(99.0), 180 - math.degrees(math.atan(99**0.5))),
        (OpAmp("x", 1e9), math.inf, 180.0),
        # (1 + x)^2 = A0^2 with A0 = 2: f_u = f1, a lag of 45 degrees each.
        (OpAmp("x", 2.0, gbw=2e3, second_pole=1e3), 1e3, 90.0),
    ],
    ids=["one pole", "no pole, no lag", "two equal poles"],
)
def test_bandwidth_and_margin_in_closed_form(model: OpAmp, f_u: float, margin: float) -> None:
    assert unity_gain_bandwidth(model) == pytest.approx(f_u, rel=1e-14)
    assert phase_margin(model) == pytest.approx(margin, rel=1e-14)


@pytest.mark.parametrize("margin", [0.0, 0.2, 90.001, 180.0, -5.0, math.nan])
def test_an_impossible_margin_names_the_possible_ones(margin: float) -> None:
    with pytest.raises(ValueError, match=r"between 0\.2562 and 90 degrees"):
        poles_from_phase_margin(2e5, 1e6, margin)


@pytest.mark.parametrize(
    "figure",
    [
        {"name": "a b"},
        {"name": "1x"},
        {"name": "x\n.include y"},
        {"name": "x\n"},
        {"dc_gain": 1.0},
        {"dc_gain": math.inf},
        {"dc_gain": math.nan},
        {"gbw": 0.0},
        {"gbw": math.nan},
        {"second_pole": -1.0},
        {"gbw": math.inf},
        {"input_resistance": 0.0},
        {"differential_capacitance": -1e-12},
        {"input_capacitance": math.inf},
        {"input_capacitance": math.nan},
        {"output_resistance": -75.0},
    ],
)
def test_a_figure_that_no_opamp_has_is_named(figure: dict[str, float | str]) -> None:
    good: dict[str, float | str] = {"name": "x", "dc_gain": 1e5, "gbw": 1e6, "second_pole": 2e6}
    named = "second_pole" if figure == {"gbw": math.inf} else next(iter(figure))
    with pytest.raises(ValueError, match=f"^{named} = "):
        OpAmp(**(good | figure))  # type: ignore[arg-type]  # mixed on purpose
