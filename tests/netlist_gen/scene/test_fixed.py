"""Keys that keep one value at every point of a study."""

from __future__ import annotations

import pytest

from taction.netlist_gen.scene.axes import parse_axes, points, with_values
from taction.netlist_gen.scene.file import load_scene
from taction.netlist_gen.scene.fixed import Fixed, check_axes, fixed_values
from taction.netlist_gen.topologies.frame.table import topology_of
from taction.system.errors import InputError
from tests.support.making import make_scene
from tests.support.paths import SCENES


def test_lambda_is_held_where_the_scene_gives_a_resistance() -> None:
    scene = load_scene(SCENES / "paper-breadboard.toml")
    own = 1.0 / (1.9e6 * 6.252e6 * 0.3313e-6**2)  # lambda = 1 / (R s G0²)
    held = with_values(scene, fixed_values(scene, "lambda"))
    for values in points(parse_axes(held, "gain=1M,20M")):
        at = with_values(held, values)
        facts = topology_of(at).facts(at)
        assert facts["lambda"].value == pytest.approx(own, rel=1e-12)
        gain = float(values["design.gain"])
        assert facts["R"].value == pytest.approx(1.0 / (own * gain * 0.3313e-6**2), rel=1e-12)


@pytest.mark.parametrize(
    "fixed", ["lambda=0.5", ["lambda=0.5"], {"lambda": 0.5}, {"design.lambda": "0.5"}]
)
def test_the_forms_of_a_fixed_value(fixed: Fixed) -> None:
    assert fixed_values(make_scene(), fixed) == {"design.lambda": 0.5}


def test_several_keys_and_units() -> None:
    expected = {"design.capacitance": 2e-12, "analysis.timeout": 30.0}
    assert fixed_values(make_scene(), ["C=2pF", "timeout=30s"]) == expected
    assert fixed_values(make_scene(), ()) == {}


@pytest.mark.parametrize(
    ("fixed", "text"),
    [
        ("lamda", "--fix: key = 'lamda': unknown key of this scene; did you mean 'lambda'?"),
        ("C=2nH", "the unit is 'H'"),
        ("initial", "give initial=VALUE"),
    ],
)
def test_what_cannot_be_fixed_is_refused(fixed: str, text: str) -> None:
    with pytest.raises(InputError) as caught:
        fixed_values(make_scene(), fixed)
    assert str(caught.value).startswith("--fix")
    assert text in str(caught.value)


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
