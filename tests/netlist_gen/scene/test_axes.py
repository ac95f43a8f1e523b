"""Axes of a study, keys that keep one value, and values that look like a slip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import (
    check_axes,
    fixed_values,
    kept_figures,
    parse_axes,
    parse_axis,
    questions,
    with_settings,
    with_values,
)
from taction.netlist_gen.scene.keys import find_key, own_value
from taction.netlist_gen.scene.scene import Scene, load_scene, parse_scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import InputError
from taction.verification.studies.sweep import Plan
from tests.support.making import make_scene
from tests.support.paths import SCENES

PERCENT = "is 500 % of the step; is it a percentage? 5 % is 0.05"
SECONDS = "has no unit and is 10 s"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SCENES / "tuned-breadboard.toml")


@pytest.mark.parametrize(
    ("name", "path", "unit", "own"),
    [
        ("C", "design.capacitance", "F", 1e-11),
        ("R", "design.resistance", "ohm", 14.4e6),
        ("s", "design.gain", "ohm", 2.3e6),
        ("gain", "design.gain", "ohm", 2.3e6),
        ("G0", "design.unit_conductance", "S", 1.16e-6),
        ("U0", "design.unit_voltage", "V", 1.0),
        ("Ve", "design.exponential_slope", "V", None),
        ("lambda", "design.lambda", "", 1.0 / (14.4e6 * 2.3e6 * 1.16e-6**2)),
        ("design.opamp.gbw", "design.opamp.gbw", "Hz", 1.38e6),
        ("opamp.gbw", "design.opamp.gbw", "Hz", 1.38e6),
        ("gbw", "design.opamp.gbw", "Hz", 1.38e6),
        ("half_width", "problem.load.half_width", "", 1.0),
        ("channels", "problem.channels", "", 7.0),
        ("variance", "problem.noise.variance", "", 0.0),
    ],
)
def test_a_key_has_a_path_a_unit_and_a_value(
    scene: Scene, name: str, path: str, unit: str, own: float | None
) -> None:
    key = find_key(scene, name)
    assert (key.path, key.unit) == (path, unit)
    value = own_value(scene, key)
    assert value == (None if own is None else pytest.approx(own, rel=1e-12))


def test_ranges_are_logarithmic_unless_told_otherwise_and_keep_their_ends(scene: Scene) -> None:
    axis = parse_axis(scene, "C=1pF:1nF:31")
    assert axis.values == pytest.approx(np.geomspace(1e-12, 1e-9, 31), rel=1e-12)
    assert (axis.values[0], axis.values[-1], axis.scale) == (1e-12, 1e-9, "log")
    axis = parse_axis(scene, "stray_capacitance=0:10p:5:lin")
    assert axis.values == (0.0, 2.5e-12, 5e-12, 7.5e-12, 1e-11)
    assert parse_axis(scene, "channels=5:25:5").values == (5, 7, 11, 17, 25)
    assert len(parse_axis(scene, "gain=1M:2M")) == 31


def test_a_bare_key_takes_a_range_around_its_own_value(scene: Scene) -> None:
    axis = parse_axis(scene, "gain", around=30.0, points=3)
    assert axis.default
    assert axis.values == pytest.approx([2.3e6 / 30.0, 2.3e6, 69e6])
    axis = parse_axis(scene, "phase_margin", around=30.0, points=61)
    assert 80.0 < float(axis.values[-1]) < 90.0


def test_groups_span_a_grid_and_zipped_keys_change_together(scene: Scene) -> None:
    groups = parse_axes(scene, ["C=1p,2p gain=1M,2M", "U0=1,3"])
    plan = Plan(scene, groups, "statespace")
    assert [plan.values_at(place) for place in range(plan.points)] == [
        {"design.capacitance": c, "design.gain": g, "design.unit_voltage": u}
        for c, g in ((1e-12, 1e6), (2e-12, 2e6))
        for u in (1.0, 3.0)
    ]


def test_another_value_is_proved_and_leaves_everything_else(scene: Scene) -> None:
    changed = with_values(scene, {"design.opamp.gbw": 1e6})
    assert changed.design.opamp.gbw == 1e6
    assert changed.file == scene.file
    assert with_values(changed, {"design.opamp.gbw": 1.38e6}) == scene
    with pytest.raises(InputError, match=r"design\.capacitance = -1\.0: must be above zero"):
        with_values(scene, {"design.capacitance": -1.0})


def test_lambda_replaces_a_resistance_and_back(scene: Scene) -> None:
    changed = with_values(scene, {"design.lambda": 0.5})
    assert (changed.design.lam, changed.design.resistance) == (0.5, None)
    changed = with_values(changed, {"design.resistance": 1e6})
    assert (changed.design.lam, changed.design.resistance) == (None, 1e6)
    with pytest.raises(InputError, match="exclude"):
        with_values(scene, {"design.lambda": 0.5, "design.resistance": 1e6})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("capacitence=1p", "did you mean 'capacitance'"),
        ("gian=1M", "did you mean 'gain'"),
        ("c=1p", "did you mean 'C'"),
        ("band=0.01", r"did you mean 'checks\.settling_time\.band'"),
        ("C", "expected values, C=1pF:1nF:31"),
        ("C=", "expected values"),
        ("C=1p-1n", "a range has colons: C=LOW:HIGH:31"),
        ("C=1e-12-1e-9", "a range has colons: C=LOW:HIGH:31"),
        ("gain=50k..500k", "a range has colons: gain=LOW:HIGH:31"),
        ("gain=50k to 500k", "a range has colons: gain=LOW:HIGH:31"),
        ("C=1p:2kV:3", "the unit is 'V'"),
        ("C=1p:2p:1", "whole number from 2"),
        ("C=1p:2p:x", "whole number from 2"),
        (f"C=1p:2p:{'9' * 5000}", "whole number from 2"),
        ("C=1p:2p:3:4", "LOW:HIGH:POINTS"),
        ("C=1p:1p:3", "both ends"),
        ("stray_capacitance=0:1p:3", "append :lin"),
        ("C=0:1p:3:lin", "must be above zero"),
        ("C=1p,nonsense", "not a number"),
        ("dc_gain=lots", "a plain number"),
        ("channels=7.5", "a whole number"),
        ("half_width=inf", "finite"),
        ("topology=ring", "topology"),
        ("Ve=1", "exponential_slope.* needs a"),
    ],
)
def test_what_cannot_be_used_is_named(scene: Scene, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        parse_axis(scene, text)


def test_zipped_keys_of_different_length_and_keys_given_twice_are_refused(scene: Scene) -> None:
    with pytest.raises(InputError, match="C has 2, gain has 3"):
        parse_axes(scene, ["C=1p,2p gain=1M,2M,3M"])
    with pytest.raises(InputError, match="the key occurs twice"):
        parse_axes(scene, ["C=1p,2p", "capacitance=1p,3p"])


def test_lambda_is_held_where_the_scene_gives_a_resistance() -> None:
    scene = load_scene(SCENES / "paper-breadboard.toml")
    own = 1.0 / (1.9e6 * 6.252e6 * 0.3313e-6**2)  # lambda = 1 / (R s G0²)
    held = with_values(scene, fixed_values(scene, "lambda"))
    for values in ({"design.gain": 1e6}, {"design.gain": 2e7}):
        at = with_values(held, values)
        facts = topology_of(at).facts(at)
        assert facts["lambda"].value == pytest.approx(own, rel=1e-12)
        gain = float(values["design.gain"])
        assert facts["R"].value == pytest.approx(1.0 / (own * gain * 0.3313e-6**2), rel=1e-12)


@pytest.mark.parametrize(
    ("over", "text"),
    [
        ("lambda=0.1,1", "leave out --over or --fix"),
        ("R=1M,2M", "replaces design.lambda, which --fix holds"),
    ],
)
def test_an_axis_must_not_change_what_is_held(over: str, text: str) -> None:
    scene = make_scene(design={"resistance": "2Mohm"})
    fixed = fixed_values(scene, "lambda")
    with pytest.raises(InputError, match=text):
        check_axes(parse_axes(with_values(scene, fixed), over), fixed)
    check_axes(parse_axes(scene, "gain=1M,2M"), fixed)


def asked(**tables: Any) -> str:
    return "\n".join(questions(make_scene(**tables)))


@pytest.mark.parametrize(
    ("check", "value", "name", "expected"),
    [
        ("settling_time", "10us", "max", 1e-5),
        ("rise_time", 2e-6, "max", 2e-6),
        ("overshoot", 0.1, "max", 0.1),
        ("undershoot", 0, "max", 0.0),
        ("noise", "1mV", "max", 1e-3),
    ],
)
def test_a_plain_value_is_the_upper_limit_of_its_check(
    check: str, value: Any, name: str, expected: float
) -> None:
    scene = make_scene(checks={check: value})
    assert scene == make_scene(checks={check: {name: value}})
    assert getattr(getattr(scene.checks, check), name) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("table", "key", "values", "says"),
    [
        ("checks", "settling_time", [10, 10.0, {"max": 10}], SECONDS),
        ("checks", "settling_time", ["10s", "10us", 1e-5, {"max": "10s"}, {"band": 0.5}], ""),
        ("checks", "overshoot", [5], PERCENT),
        ("checks", "overshoot", [0.05], ""),
        ("checks", "undershoot", [5], PERCENT),
        ("checks", "undershoot", [0.05], ""),
        ("design", "capacitance", ["0.5pF", "10pF", "1uF", "47uF"], ""),
        ("design", "gain", ["1kohm"], ""),
        ("tolerances", "resistor", [0.1], ""),
    ],
)
def test_what_looks_like_a_slip_is_asked_about_and_what_is_usual_is_not(
    table: str, key: str, values: list[Any], says: str
) -> None:
    for value in values:
        found = asked(**{table: {key: value}})
        assert says in found
        assert bool(found) is bool(says), value


@pytest.mark.parametrize(
    ("key", "value"),
    [("gain", "6.252mohm"), ("gain", "0.5"), ("capacitance", 10), ("capacitance", 2.0)],
)
def test_a_value_that_no_board_has_is_refused(key: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"design\.{key} .* what no board has; is the prefix"):
        make_scene(design={key: value})


@pytest.mark.parametrize("design", [{}, {"opamp": "lf353"}, {"opamp": {"gbw": "1MHz"}}])
def test_opamp_is_the_key_of_its_preset(design: dict[str, Any]) -> None:
    scene = parse_scene({"problem": {"kind": "tactile"}, "design": design}, "a.toml")
    ((axis,),) = parse_axes(scene, "opamp=ua741,op27")
    assert axis.values == ("ua741", "op27")
    changed = with_values(scene, {axis.key.path: "op27"})
    said = "\n".join((*questions(changed), *kept_figures(scene, [axis.key.path])))
    own = "gbw" in scene.design.opamp.model_fields_set
    assert said.count("another base of the op-amp: it keeps the scene's own gbw;") == 2 * own
    assert changed.design.opamp.base == "op27"
    assert changed.design.opamp.gbw == scene.design.opamp.gbw
    with pytest.raises(InputError, match="did you mean 'op27'"):
        parse_axes(scene, "opamp=op72")


@pytest.mark.parametrize(
    ("setting", "checks"),
    [
        ("checks.overshoot=0.1", {"overshoot": 0.1}),
        ("checks.overshoot.max=0.1", {"overshoot": 0.1}),
        ("checks.rise_time=1us", {"rise_time": "1us"}),
        ("checks.settling_time=10us", {"settling_time": "10us"}),
        ("checks.noise.lowest=1Hz checks.noise=1mV", {"noise": {"lowest": 1.0, "max": 1e-3}}),
    ],
)
def test_a_table_that_the_scene_lacks_can_be_set_and_by_its_one_value(
    setting: str, checks: dict[str, Any]
) -> None:
    assert with_settings(make_scene(), setting.split()) == make_scene(checks=checks)
    assert own_value(make_scene(), find_key(make_scene(), "checks.noise.lowest")) is None


def test_a_board_of_defaults_is_named() -> None:
    """It fails by far with the input errors of its uA741; one key of its parts is a choice."""
    matrix, strain = [[1.0, 0.5], [0.5, 1.0]], [0.2, 0.1]
    (found,) = questions(Scene.from_arrays(matrix, strain))
    assert found.startswith("design.opamp, gain and unit_conductance are not given")
    assert "`taction new --matrix T.csv --strain eps.csv`" in found
    assert not questions(Scene.from_arrays(matrix, strain, opamp="opa2134"))
