"""Values that look like a slip are asked about; what is usual is not."""

from __future__ import annotations

from typing import Any

import pytest

from taction.netlist_gen.scene.axes import parse_axes, with_value
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.netlist_gen.scene.slips import axis_questions, questions
from taction.system.errors import InputError
from tests.support.making import make_scene


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


PERCENT = "is 500 % of the step; is it a percentage? 5 % is 0.05"
PREFIX = "is the prefix right?"
SECONDS = "has no unit and is 10 s"


@pytest.mark.parametrize(
    ("table", "key", "values", "says"),
    [
        ("checks", "settling_time", [10, 10.0, {"max": 10}], SECONDS),
        ("checks", "settling_time", ["10s", "10us", 1e-5, {"max": "10s"}, {"band": 0.5}], ""),
        ("checks", "overshoot", [5], PERCENT),
        ("checks", "overshoot", [0.05], ""),
        ("checks", "undershoot", [5], PERCENT),
        ("checks", "undershoot", [0.05], ""),
        ("design", "capacitance", ["1e-20F", "1F", "10mF", "10F"], PREFIX),
        ("design", "capacitance", ["0.5pF", "10pF", "1uF", "47uF"], ""),
        ("design", "gain", [0.5], "is below 1 ohm; is the prefix right?"),
        ("design", "gain", ["1kohm"], ""),
        ("tolerances", "resistor", [10.0], "10 % is 0.1"),
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
    changed = with_value(scene, axis.key.path, "op27")
    said = "\n".join((*questions(changed), *axis_questions(scene, [[axis]])))
    own = "gbw" in scene.design.opamp.model_fields_set
    assert said.count("another base of the op-amp: it keeps the scene's own gbw;") == 2 * own
    assert changed.design.opamp.base == "op27"
    assert changed.design.opamp.gbw == scene.design.opamp.gbw
    with pytest.raises(InputError, match="did you mean 'op27'"):
        parse_axes(scene, "opamp=op72")


def test_a_board_of_defaults_is_named() -> None:
    """It fails by far with the input errors of its uA741; one key of its parts is a choice."""
    matrix, strain = [[1.0, 0.5], [0.5, 1.0]], [0.2, 0.1]
    (found,) = questions(Scene.from_arrays(matrix, strain))
    assert found.startswith("design.opamp, gain and unit_conductance are not given")
    assert "`taction new --matrix T.csv --strain eps.csv`" in found
    assert not questions(Scene.from_arrays(matrix, strain, opamp="opa2134"))
