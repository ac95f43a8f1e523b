"""Warnings about parts: which, how many, the extreme one by name, and a remedy that works."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.part_warnings import (
    broken_limits,
    part_warnings,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
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
            "2 of 2 resistors R are above 10 Mohm, up to 60 Mohm (Rr_1); remedy: a smaller"
            " design.resistance",
        ),
        (
            {"gain": "9ohm", "resistance": "1Mohm"},
            "1 of 1 resistors s are below 10 ohm, down to 9 ohm (Rs_1); remedy: a larger"
            " design.gain",
        ),
        (
            {"inverter_resistance": "6ohm"},
            "4 of 4 inverter resistors are below 10 ohm, down to 6 ohm (Ra_1_in); remedy: a"
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
    """1/(|T| G0) is 100 kohm / |T|: 1e-3 and 1e-4 are above 10 Mohm, 2e4 is below 10 ohm."""
    T = [[1.0, -1e-3, 0.0], [2e4, 1e-4, 1.0]]
    high, low = warnings(T)
    assert high.startswith(
        "4 of 10 matrix resistors are above 10 Mohm, up to 1 Gohm (Rf_2_2); remedy: a larger"
        " design.unit_conductance"
    )
    assert low == (
        "2 of 10 matrix resistors are below 10 ohm, down to 5 ohm (Rf_2_1); remedy: a smaller"
        " design.unit_conductance"
    )


def at_rest(**design: Any) -> list[str]:
    scene = make_scene(design=GOOD | design)
    circuit = synthesise(scene, matrix_problem([[1.0, 0.5]], [1.0]))
    return list(broken_limits(circuit, LinearBoard(circuit).equilibrium.__getitem__))


@pytest.mark.parametrize(
    ("design", "kinds"),
    [
        # eps G0 U0: 1 x 10 uS x 0.5 mV is 5 nA; 1 x 10 mS x 1.5 V is 15 mA, a voltage's, too
        ({"unit_voltage": "0.5mV"}, ["largest strain currents below 10 nA"]),
        ({"unit_voltage": "1.5V", "unit_conductance": "10mS"}, ["strain currents above 10 mA"]),
        (
            {"unit_voltage": "1.5V", "unit_conductance": "10mS", "strain_input": "voltage"},
            ["strain currents above 10 mA"],
        ),
        # u is about 0.8 of U0; from 1.5 V into 50 ohm an inverter's input takes 24 mA
        ({"unit_voltage": "1.5V", "inverter_resistance": "50ohm"}, ["output currents of op-amps"]),
        ({"opamp": {"base": "ideal", "slew_rate": 1e6}, "supply": 20}, ["supplies of op-amps"]),
        ({"opamp": {"base": "ideal", "slew_rate": 1e6}, "supply": 2}, ["supplies of op-amps"]),
        ({"opamp": "lmp7721", "supply": 2}, []),  # its own sheet allows it
        ({"opamp": "opa2134", "inverter_resistance": "50ohm"}, []),  # it has a check of its own
    ],
)
def test_currents_and_supplies(design: dict[str, Any], kinds: list[str]) -> None:
    found = at_rest(**{"opamp": "ideal"} | design)
    assert [name[: len(kind)] for name, kind in zip(found, kinds, strict=True)] == kinds


def test_common_mode_at_rest() -> None:
    """The exponential stages of transistors have an op-amp whose input is not ground."""
    design = GOOD | {"opamp": "ideal"}
    circuit = synthesise(make_scene(design=design), matrix_problem([[1.0]], [1.0]))
    cell = replace(circuit.opamps[0], noninverting="high")
    lifted = replace(circuit, opamps=(cell, *circuit.opamps[1:]))
    found = broken_limits(lifted, lambda node: 13.0 if node == "high" else 0.0)
    assert list(found) == ["common-mode voltages at rest above 80 % of the supply"]
    assert broken_limits(circuit, lambda node: 1300.0) == {}  # equal voltages: no current


def test_the_largest_strain_counts_and_a_voltage_by_its_resistor() -> None:
    design = GOOD | {"unit_voltage": "1.5V", "unit_conductance": "10mS", "strain_input": "voltage"}
    problem = matrix_problem([[1.0], [1.0]], [1.0, 1e-7])
    (found,) = part_warnings(synthesise(make_scene(design=design), problem))
    assert found.startswith("1 of 2 strain currents are above 10 mA, up to 15 mA (Veps_1); remedy")
    small = GOOD | {"unit_voltage": "1V"}
    assert part_warnings(synthesise(make_scene(design=small), problem)) == ()
