"""Presets as the data file prints them, and presets with some figures changed."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.spice_models.input_errors import spreads
from taction.spice_models.opamp import (
    OpAmp,
    Spread,
    phase_margin,
    poles_from_phase_margin,
    second_pole_from_phase_margin,
    unity_gain_bandwidth,
)
from taction.spice_models.presets import derive, figure_origins, load_presets, tables

PRINTED = tables()
OLD = ("ideal", "ua741", "lf353", "tl084", "lf356", "ne5534", "op27")
NEW = ("lm324", "tl072", "tl074", "opa2134", "ad711", "ad8065", "lt1028", "opa1612")
NEW += ("lmp7721", "opa189")
NAMES = (*OLD, *NEW)
NO_FIGURES = {"source", "external_part", "guaranteed", "origin", "like"}


@pytest.fixture
def ua741() -> OpAmp:
    return load_presets()["ua741"]


def test_every_preset_is_there_and_names_its_source() -> None:
    assert tuple(load_presets()) == NAMES
    assert all(opamp.source and "://" not in opamp.source for opamp in load_presets().values())


@pytest.mark.parametrize("name", NAMES)
def test_figures_are_those_of_the_file(name: str) -> None:
    model = load_presets()[name]
    printed = {key: value for key, value in PRINTED[name].items() if key not in NO_FIGURES}
    f_u, margin = printed.pop("unity_gain_bandwidth"), printed.pop("phase_margin", 180.0)
    assert unity_gain_bandwidth(model) == pytest.approx(f_u, rel=1e-12)
    assert phase_margin(model) == pytest.approx(margin, abs=1e-9)
    assert {key: getattr(model, key) for key in printed} == printed


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_has_one_document_or_is_assumed(name: str) -> None:
    """A document has a publisher and a part; a derived figure says how."""
    table = PRINTED[name]
    limits = [f"guaranteed.{key}" for key in table.get("guaranteed", {})]
    listed = [figure for figures in table["origin"].values() for figure in figures]
    assert len(listed) == len({*listed})
    figures = {*(table.keys() - NO_FIGURES), *limits}
    assert {*listed} <= figures
    assert {*load_presets()[name].assumed} == figures - {*listed}
    for document, figures in table["origin"].items():
        assert figures
        assert document == "derived" or re.fullmatch(r"[A-Z][\w -]+, .*\d+.*", document)
    notes = {key: origin.note for key, origin in figure_origins(name).items()}
    if name != "ideal":
        assert all(notes[key] for key in table["origin"].get("derived", ()))


def test_a_part_may_be_like_another_one() -> None:
    two, four = (load_presets()[name] for name in ("tl072", "tl074"))
    assert four == replace(two, name="tl074", channels_per_package=4)
    assert figure_origins("tl074") == figure_origins("tl072")


@pytest.mark.parametrize("name", NAMES)
def test_a_guaranteed_limit_is_beyond_the_typical_figure(name: str) -> None:
    model = load_presets()[name]
    assert dict(model.guaranteed) == PRINTED[name].get("guaranteed", {})
    for figure, limit in model.guaranteed:
        typical = abs(getattr(model, figure))
        least = figure in ("common_mode_rejection", "supply_rejection", "dc_gain")
        assert limit < typical if least else limit > typical, figure


def test_every_real_part_has_every_figure() -> None:
    optional = {"like", "external_part", "guaranteed", "bias_drift", "bias_doubling"}
    optional |= {"input_resistance", "differential_capacitance", "input_capacitance"}
    optional |= {"voltage_noise_corner"}
    every = set().union(*PRINTED.values()) - optional
    for name in NAMES[1:]:
        assert every <= set(PRINTED[name]), name


def test_changed_gbw_takes_the_second_pole_along(ua741: OpAmp) -> None:
    slow = derive(ua741, "slow", gbw=790e3)
    assert slow.gbw == 790e3
    assert slow.second_pole / slow.gbw == pytest.approx(ua741.second_pole / ua741.gbw, rel=1e-15)
    assert phase_margin(slow) == pytest.approx(65.0, abs=1e-3)
    assert slow.input_resistance == 2e6
    assert slow.source.startswith("ua741 with gbw = 790000.0; Texas Instruments")


GIVEN: dict[str, float] = {"gbw": 790e3, "second_pole": 2.37e6, "output_resistance": 0.0}


@pytest.mark.parametrize(
    ("preset", "changes", "expected"),
    [
        ("ua741", GIVEN, GIVEN),
        ("ua741", {"dc_gain": 1e5}, {"dc_gain": 1e5, "gbw": None, "second_pole": None}),
        ("ua741", {"channels_per_package": 2}, {"channels_per_package": 2, "gbw": None}),
        ("ideal", {"gbw": 1e6}, {"gbw": 1e6, "second_pole": math.inf}),
        ("ua741", {"gbw": math.inf}, {"gbw": math.inf, "second_pole": math.inf}),
    ],
    ids=[
        "second pole given",
        "another gain",
        "two in a package",
        "a pole for the ideal one",
        "poles taken away",
    ],
)
def test_figures_that_are_given_stay_and_others_follow(
    preset: str, changes: dict[str, float], expected: dict[str, float | None]
) -> None:
    """None: as before."""
    before = load_presets()[preset]
    changed = derive(before, "x", **changes)
    for name, value in expected.items():
        assert getattr(changed, name) == (getattr(before, name) if value is None else value)


@pytest.mark.parametrize(
    ("figures", "text"),
    [
        ({"slew": 0.5e6}, "slew: not a figure of an op-amp; known: dc_gain, gbw"),
        ({"second_pole": 1e6, "phase_margin": 60.0}, "give one of the two"),
        ({"phase_margin": 95.0}, "between 0.2562 and 90 degrees"),
        ({"phase_margin": 20.0, "dc_gain": 10.0}, "between 36.87 and 95.74 degrees"),
        ({"phase_margin": 60.0, "gbw": math.inf}, "needs a finite gbw"),
        ({"phase_margin": 60.0, "dc_gain": 0.0}, "dc_gain = 0.0: must be finite and above 1"),
        ({"gbw": -1.0}, "gbw = -1.0: must be above 0"),
        ({"gbw": math.nan}, "gbw = nan: must be above 0"),
        ({"input_capacitance": -1e-12}, "must be finite, 0 or more"),
    ],
)
def test_contradictions_are_named(ua741: OpAmp, figures: dict[str, float], text: str) -> None:
    with pytest.raises(ValueError, match=text.replace(".", r"\.")):
        derive(ua741, "x", **figures)


def test_a_limit_that_no_document_confirms_is_an_assumed_spread() -> None:
    """The OPA189's limits are from memory; a TL084's are in its sheet, an AD8065 has none."""
    found = {name: spreads(load_presets()[name]) for name in ("opa189", "tl084", "ad8065")}
    assert all(each.assumed for each in found["opa189"].values())
    assert not any(each.assumed for each in found["tl084"].values())
    assert found["ad8065"]["bias_current"] == Spread(0.0, 2e-12 / 0.67, True)
    assert not found["ad8065"]["offset_voltage"].assumed


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


NO_FIGURE: dict[str, tuple[float | str, ...]] = {
    "name": ("a b", "1x", "x\n.include y", "x\n"),
    "dc_gain": (1.0, math.inf, math.nan),
    "gbw": (0.0, math.nan),
    "second_pole": (-1.0,),
    "input_resistance": (0.0,),
    "differential_capacitance": (-1e-12,),
    "input_capacitance": (math.inf, math.nan),
    "output_resistance": (-75.0,),
}


@pytest.mark.parametrize("figure", NO_FIGURE)
def test_a_figure_that_no_opamp_has_is_named(figure: str) -> None:
    good: dict[str, float | str] = {"name": "x", "dc_gain": 1e5, "gbw": 1e6, "second_pole": 2e6}
    for wrong in NO_FIGURE[figure]:
        with pytest.raises(ValueError, match=f"^{figure} = "):
            OpAmp(**(good | {figure: wrong}))  # type: ignore[arg-type]  # mixed on purpose
    with pytest.raises(ValueError, match=r"^second_pole = "):
        OpAmp(**(good | {"gbw": math.inf}))  # type: ignore[arg-type]
