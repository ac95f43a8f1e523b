"""Warnings about parts: which, how many, the extreme one by name, and a remedy that works."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.part_warnings import part_warnings
from taction.netlist_gen.board.synthesis import synthesise
from tests.support.making import make_scene, matrix_problem

GOOD = {"unit_conductance": "10uS", "resistance": "1Mohm", "gain": "100kohm"}


def warnings(T: Any = ((1.0, -0.5),), **design: Any) -> tuple[str, ...]:
    problem = matrix_problem(T, np.ones(len(T)))
    return part_warnings(synthesise(make_scene(design=GOOD | design), problem))


def test_a_board_of_common_parts_has_none() -> None:
    assert warnings() == ()
    assert warnings(amplifier="exponential") == ()


@pytest.mark.parametrize(
    ("design", "says"),
    [
        (
            {"resistance": "60Mohm"},
            "2 of 2 resistors R are above 50 Mohm, up to 60 Mohm (Rr_1); remedy: a smaller"
            " design.resistance",
        ),
        (
            {"gain": "99ohm", "resistance": "1Mohm"},
            "1 of 1 resistors s are below 100 ohm, down to 99 ohm (Rs_1); remedy: a larger"
            " design.gain",
        ),
        (
            {"inverter_resistance": "60ohm"},
            "4 of 4 inverter resistors are below 100 ohm, down to 60 ohm (Ra_1_in); remedy: a"
            " larger design.inverter_resistance",
        ),
        (
            {"capacitance": "8pF"},
            "2 of 2 capacitors C are below the stray capacitance of 10 pF, down to 8 pF (Cc_1);"
            " remedy: a larger design.capacitance, or a layout with a smaller"
            " design.stray_capacitance",
        ),
    ],
)
def test_each_kind_names_part_value_and_remedy(design: dict[str, Any], says: str) -> None:
    assert says in warnings(**design)


def test_the_matrix_has_one_warning_for_each_limit() -> None:
    """1/(|T| G0) is 100 kohm / |T|: 1e-3 and 1e-4 are above 50 Mohm, 2e3 is below 100 ohm."""
    T = [[1.0, -1e-3, 0.0], [2e3, 1e-4, 1.0]]
    high, low = warnings(T)
    assert high.startswith(
        "4 of 10 matrix resistors are above 50 Mohm, up to 1 Gohm (Rf_2_2); remedy: a larger"
        " design.unit_conductance"
    )
    assert low == (
        "2 of 10 matrix resistors are below 100 ohm, down to 50 ohm (Rf_2_1); remedy: a smaller"
        " design.unit_conductance"
    )


def test_the_limits_themselves_are_accepted() -> None:
    assert warnings(resistance="50Mohm", inverter_resistance="100ohm") == ()
    assert warnings(capacitance="10pF", stray_capacitance="10pF") == ()
    assert warnings(capacitance="1fF", stray_capacitance=0) == ()
