"""Offset voltage, input currents and common-mode rejection: closed forms, and both engines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.circuit import GROUND, Circuit, Output
from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.parts import OpAmpCell, Resistor
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.design import OpAmpChoice
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.verification.engines.ngspice.process import find_simulator, simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.paths import SCENES
from tests.support.small_decks import SmallDeck

OFFSET, BIAS, DIFFERENCE, REJECTION = 2e-3, 80e-9, 20e-9, 60.0
UA741 = replace(
    OPAMPS["ua741"],
    input_errors=True,
    offset_voltage=OFFSET,
    bias_current=BIAS,
    offset_current=DIFFERENCE,
    common_mode_rejection=REJECTION,
)


def part(**figures: float) -> OpAmp:
    """A gain of 1e9 without impedances, with some input errors."""
    return OpAmp("part", 1e9, gbw=1e6, input_errors=True, **figures)


def bench(model: OpAmp, *resistors: Resistor, follower: bool = False) -> Circuit:
    """One op-amp whose output is ``out``: inverting, or a follower of node ``in``."""
    pins = ("in", "out", "out") if follower else (GROUND, "sum", "out")
    return replace(
        synthesise(load_scene(SCENES / "custom-matrix.toml")),
        models={model.name: model},
        opamps=(OpAmpCell("one", model.name, *pins),),
        resistors=resistors,
        matrices=(),
        capacitors=(),
        currents=(),
        outputs=(Output("out", 1.0),),
    )


def by_equations(circuit: Circuit) -> float:
    return LinearBoard(circuit).equilibrium["out"]


def by_ngspice(circuit: Circuit) -> float:
    (model,), one = circuit.models.values(), circuit.opamps[0]
    grounded = one.noninverting == GROUND
    cards = [
        ".title one op-amp",
        str(opamp_subcircuit(model, noninverting_grounded=grounded, supply=15.0)),
    ]
    cards += [f"Xone {one.noninverting} {one.inverting} {one.output} {one.model}"]
    cards += [f"R{r.name} {r.a} {r.b} {r.ohms!r}" for r in circuit.resistors]
    cards += [".options reltol=1e-9 abstol=1e-18 vntol=1e-12", ".save v(out)", ".op", ".end", ""]
    deck = SmallDeck("\n".join(cards), ("out",), OperatingPoint())
    return float(simulate(deck, find_simulator(), timeout=60.0)["out"][-1])


DIVIDER = (Resistor("in", "sum", GROUND, 1e4), Resistor("fb", "out", "sum", 9e4))
LEAK = Resistor("leak", "in", GROUND, 1e6)
CLOSED_FORMS = {
    # v- = Vos, and so the output is (1 + 90/10) Vos
    "offset": (part(offset_voltage=1e-3), DIVIDER, False, 10e-3),
    # I- = 80 nA flows through 90 kohm
    "bias": (part(bias_current=80e-9), DIVIDER, False, 7.2e-3),
    # I- = -10 nA
    "offset current": (part(offset_current=20e-9), DIVIDER, False, -0.9e-3),
    # I+ = 80 nA + 10 nA through 1 Mohm holds the input at -90 mV
    "follower": (part(bias_current=80e-9, offset_current=20e-9), (LEAK,), True, -90e-3),
    # v+ - v- + 1e-3 (v+ + v-) / 2 = 0 at v+ = -0.1 V: v- = v+ (1 + 5e-4) / (1 - 5e-4)
    "rejection": (
        part(bias_current=100e-9, common_mode_rejection=60.0),
        (LEAK,),
        True,
        -0.1 * (1.0 + 5e-4) / (1.0 - 5e-4),
    ),
}


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_an_output_at_rest_is_that_of_the_closed_form(name: str) -> None:
    model, resistors, follower, expected = CLOSED_FORMS[name]
    circuit = bench(model, *resistors, follower=follower)
    assert by_equations(circuit) == pytest.approx(expected, rel=1e-7)
    assert by_ngspice(circuit) == pytest.approx(expected, rel=1e-6)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("large_signal", [False, True])
@pytest.mark.parametrize("follower", [False, True])
def test_a_whole_model_rests_alike_in_both_engines(follower: bool, large_signal: bool) -> None:
    model = replace(UA741, large_signal=large_signal)
    circuit = bench(model, *((LEAK,) if follower else DIVIDER), follower=follower)
    assert by_equations(circuit) == pytest.approx(by_ngspice(circuit), rel=1e-6)


def chosen(**opamp: Any) -> OpAmp:
    choice = {"base": "ua741", "input_errors": "typical", **opamp}
    return choose_opamp(make_scene(design={"opamp": choice}))


@pytest.mark.parametrize("level", ["typical", True])
def test_typical_errors_are_those_of_the_sheet_and_of_the_scene(level: str | bool) -> None:
    assert OpAmpChoice().input_errors == "typical"
    assert chosen(input_errors=level).input_currents == (90e-9, 70e-9)
    assert chosen(input_errors=level).input_offset == 1e-3
    assert chosen(input_errors=level).rejection_error == pytest.approx(10.0**-4.5)
    both = chosen(input_errors=level, bias_current="-1nA")
    assert both.input_currents == pytest.approx((9e-9, -11e-9))
    assert both.input_offset == 1e-3
    assert "bias_current" not in dict(both.varying)


@pytest.mark.parametrize("level", ["none", False])
def test_without_errors_only_those_of_the_scene_count(level: str | bool) -> None:
    assert not chosen(input_errors=level).input_errors
    one = chosen(input_errors=level, offset_voltage="-2mV")
    assert (one.input_offset, one.input_currents, one.rejection_error) == (-2e-3, (0.0, 0.0), 0.0)
    assert not one.varying


def test_the_largest_errors_are_three_standard_deviations() -> None:
    typical, most = chosen(), chosen(input_errors="max")
    for name, each in typical.varying:
        if name != "common_mode_rejection":
            expected = abs(each.mean) + 3.0 * each.sigma
            assert abs(getattr(most, name)) == pytest.approx(expected)
    assert most.rejection_error > typical.rejection_error


ERRORS = {"base": "tl084", "offset_voltage": "3mV", "bias_current": "20nA", "offset_current": "4nA"}
SCENES_WITH_ERRORS: dict[str, dict[str, Any]] = {
    "integrator": {},
    "rest": {"initial": "rest"},
    "passive": {"topology": "passive", "lam": 10.0, "common_mode_rejection": 60.0},
    "exponential": {"amplifier": "exponential", "exponential_slope": 0.2, "initial": "rest"},
}


def board(**values: Any) -> Scene:
    T = np.array([[1.0, 0.4, -0.2], [0.3, 0.9, 0.1], [-0.2, 0.2, 1.1]])
    opamp = {**ERRORS, "common_mode_rejection": values.pop("common_mode_rejection", 80.0)}
    design = {"capacitance": 1e-10, "gain": 1e5, "unit_conductance": 1e-5, "lam": 0.2}
    return Scene.from_arrays(
        T, [0.7, 0.5, 0.4], **{**design, "opamp": opamp, "error": 5e-5, **values}
    )


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", SCENES_WITH_ERRORS)
def test_both_engines_agree_on_boards_with_errors(name: str) -> None:
    verdict = verify(board(**SCENES_WITH_ERRORS[name]).with_engine("ngspice"))
    agree = next(check for check in verdict.checks if check.name == "engines_agree")
    assert agree.outcome is Outcome.PASS
    assert agree.value < 1e-4
    without = board(**SCENES_WITH_ERRORS[name], opamp={"base": "tl084", "input_errors": "none"})
    clean = LinearBoard(synthesise(without))
    moved = LinearBoard(verdict.circuit)
    nodes = [output.node for output in verdict.circuit.outputs]
    apart = [moved.equilibrium[node] - clean.equilibrium[node] for node in nodes]
    assert max(map(abs, apart)) > 1e-3  # V
