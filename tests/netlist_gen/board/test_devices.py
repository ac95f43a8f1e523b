"""Devices of arrays at some conductances, windows and levels; what a board states about itself."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from taction.netlist_gen.board.arrays import Device, load_devices
from taction.netlist_gen.board.circuit import Circuit, Role, common_facts
from taction.netlist_gen.board.part_warnings import broken_limits, part_warnings
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.design import DevicesTable
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.families import scaled_parts
from tests.support.making import make_scene, matrix_problem

# By hand, from the formulas in the sources, in uS: conductance and standard deviation.
PRINTED = {
    "rram-wan": ((10.0, 1.053 + 2.374 - 1.167 + 0.1536), (30.0, 1.053 + 7.122 - 10.503 + 4.1472)),
    "rram-milo": ((50.0, 4.782 - 0.45535), (225.0, 4.782 - 2.049075)),
    "pcm-joshi": ((1.0, 0.2864 + 0.07586 - 0.001788), (20.0, 0.2864 + 1.5172 - 0.7152)),
    "pcm-aihwkit": (
        (10.0, 0.26348 + 1.9650 * 0.4 - 1.1731 * 0.16),
        (25.0, 0.26348 + 1.9650 - 1.1731),
    ),
}
WINDOWS = {
    "pcm-aihwkit": (0.25, 25.0),
    "rram-wan": (1.0, 39.26),
    "rram-milo": (50.0, 225.0),
    "pcm-joshi": (0.25, 25.0),
}
GOOD = {"unit_conductance": "10uS", "resistance": "1Mohm", "gain": "100kohm"}
DESIGN = {"capacitance": "10pF", "resistance": "2Mohm", "gain": "1Mohm"}


def test_every_device_has_its_window_its_error_and_its_source() -> None:
    devices = load_devices()
    assert devices.keys() == PRINTED.keys()
    (cells, _) = get_args(DevicesTable.model_fields["cell"].annotation)
    assert get_args(cells) == tuple(devices)
    for name, device in devices.items():
        window = device.least_conductance, device.most_conductance
        assert window == pytest.approx([1e-6 * x for x in WINDOWS[name]])
        assert device.source.startswith(("CrossSim", "aihwkit"))
        for micro, wanted in PRINTED[name]:
            (found,) = device.spread(np.array([1e-6 * micro]))
            assert found == pytest.approx(1e-6 * wanted, rel=1e-9)
        inside = np.linspace(*window, 200)
        assert np.all(device.spread(inside) > 0.0)


def test_levels_are_evenly_spaced_and_reached_from_halfway() -> None:
    device = Device(0.5e-6, 35.5e-6, cell_levels=8)
    wanted = np.array([0.0, 1e-7, 3.1e-6, 2.9e-6, 40e-6])
    np.testing.assert_allclose(
        device.settable(wanted), [0.0, 0.5e-6, 5.5e-6, 0.5e-6, 35.5e-6], rtol=1e-12
    )


def test_programmed_conductances_stay_within_the_window() -> None:
    device = Device(1e-6, 9e-6, programming_error=(2e-6,))
    aimed = np.full(4, 5e-6)
    found = device.programmed(aimed, np.array([0.0, 1.0, 5.0, -5.0]))
    np.testing.assert_allclose(found, [5e-6, 7e-6, 9e-6, 1e-6], rtol=1e-12)


def test_drift_is_the_power_law_of_its_source_and_has_an_inverse() -> None:
    """aihwkit: nu = clip(-0.0155 ln x + 0.0244, 0.049, 0.1), sd clip(-0.0125 ln x - 0.0059, ..)."""
    day = replace(load_devices()["pcm-aihwkit"], age=86400.0)
    aimed, ratio = 25e-6 * np.array([1e-2, 1e-1, 1.0]), 86400.0 / 20.0
    nu = [0.0244 + 0.0155 * math.log(100.0), 0.0244 + 0.0155 * math.log(10.0), 0.049]
    now = day.drifted(aimed)
    np.testing.assert_allclose(now, aimed * ratio ** -np.array(nu), rtol=1e-12)
    np.testing.assert_allclose(day.programmed_for(now), aimed, rtol=1e-12)
    spread = np.array([0.045, 0.0125 * math.log(10.0) - 0.0059, 0.008])
    np.testing.assert_allclose(day.spreads(now)["drift"], now * math.log(ratio) * spread, rtol=1e-9)
    fresh = load_devices()["pcm-aihwkit"].spreads(aimed)["programming"]
    np.testing.assert_allclose(day.spreads(now)["programming"], fresh * now / aimed, rtol=1e-9)


def test_a_share_of_the_cells_is_stuck_and_others_are_as_before(
    rng: np.random.Generator,
) -> None:
    cell = Device(1e-6, 9e-6, programming_error=(1e-8,), stuck_at_least=0.1, stuck_at_most=0.02)
    found = cell.programmed(np.full(20_000, 5e-6), rng.standard_normal(20_000))
    for end, share in ((1e-6, 0.1), (9e-6, 0.02)):
        count = np.count_nonzero(found == end)
        assert count == pytest.approx(20_000 * share, abs=4.0 * math.sqrt(20_000 * share))
    others = found[(found > 1e-6) & (found < 9e-6)]
    assert np.std(others) == pytest.approx(1e-8, rel=4.0 / math.sqrt(2.0 * len(others)))


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


def board(topology: str = "integrator", **design: object) -> Circuit:
    tables = {**DESIGN, "topology": topology, "opamp": "ua741", **design}
    return synthesise(make_scene({"channels": 3}, design=tables))


@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_every_part_has_a_role(topology: str) -> None:
    circuit = board(topology, unit_conductance="1nS")
    stated = [name for names in circuit.roles.values() for name in names]
    parts = [part.card for part in (*circuit.resistors, *circuit.capacitors)]
    assert sorted(stated) == sorted([*parts, "Rf", "Rb"])
    assert len(circuit.parts_of(Role.SIGNAL_CAPACITOR)) == 3
    assert len(circuit.parts_of(Role.CONSTRAINT_RESISTOR)) == 3
    assert len(circuit.real_capacitors) == 3
    assert circuit.shape == (3, 3)
    assert (circuit.forward.name, circuit.feedback.name) == ("Rf", "Rb")
    assert next(circuit.feedback.resistors()).card == "Rb_1_1"


def test_facts_have_their_number_and_their_text() -> None:
    circuit = board()
    assert list(circuit.facts) == ["G0", "U0", "R", "C", "gain", "lambda"]
    assert circuit.value("R") == 2e6
    assert circuit.facts["gain"].text == "1 MΩ"
    assert circuit.facts["gain"].symbol == "s"
    exponential = board(amplifier="exponential", exponential_slope="70mV")
    assert exponential.value("Ve") == 0.07
    assert common_facts(C=1e-12)["C"].key == "design.capacitance"


def values(circuit: Circuit) -> dict[str, float]:
    resistors = {part.card: part.ohms for part in circuit.resistors}
    return resistors | {part.card: part.farads for part in circuit.capacitors}


@pytest.mark.parametrize("topology", ["integrator", "passive"])
@pytest.mark.parametrize(("name", "value"), [("C", 3e-12), ("gain", 3e6)])
def test_a_turned_knob_is_the_board_of_its_scene(topology: str, name: str, value: float) -> None:
    circuit = board(topology, unit_conductance="1nS")
    knob = circuit.knob(name)
    scene = make_scene(
        {"channels": 3},
        design={**DESIGN, "topology": topology, "opamp": "ua741", "unit_conductance": "1nS"},
    )
    other, turned = synthesise(with_values(scene, {knob.key: value})), circuit.turned(name, value)
    assert values(turned) == pytest.approx(values(other), rel=1e-12)
    for fact in other.facts.values():
        assert turned.value(fact.name) == pytest.approx(fact.value, rel=1e-12)
    assert scaled_parts(circuit, [knob]) != scaled_parts(turned, [knob])
