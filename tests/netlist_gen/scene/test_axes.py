"""Axes of a study, and keys that keep one value."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import (
    check_axes,
    fixed_values,
    parse_axes,
    parse_axis,
    with_value,
    with_values,
)
from taction.netlist_gen.scene.keys import find_key, own_value
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import InputError
from taction.verification.studies.sweep.plan import Plan
from tests.support.making import make_scene
from tests.support.paths import SCENES


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
    changed = with_value(scene, "design.opamp.gbw", 1e6)
    assert changed.design.opamp.gbw == 1e6
    assert changed.file == scene.file
    assert with_value(changed, "design.opamp.gbw", 1.38e6) == scene
    with pytest.raises(InputError, match=r"design\.capacitance = -1\.0: must be above zero"):
        with_value(scene, "design.capacitance", -1.0)


def test_lambda_replaces_a_resistance_and_back(scene: Scene) -> None:
    changed = with_value(scene, "design.lambda", 0.5)
    assert (changed.design.lam, changed.design.resistance) == (0.5, None)
    changed = with_value(changed, "design.resistance", 1e6)
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
