"""Offset voltage, input currents and common-mode rejection; the chain of an imported op-amp."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.circuit import GROUND, Circuit, Output
from taction.netlist_gen.board.opamp_choice import choose_opamp, to_document
from taction.netlist_gen.board.parts import OpAmpCell, Resistor
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.design import OpAmpChoice
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene, load_scene, parse_scene
from taction.spice_models.input_errors import drawn
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.system.errors import InputError
from taction.verification.engines.ngspice.process import Simulation, find_simulator, simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.studies.decks.vendor_model import import_opamp
from taction.verification.studies.onset import onset
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.measured import named
from tests.support.paths import SCENES
from tests.support.small_decks import SmallDeck

FIGURES = {"bias_current": 80e-9, "offset_current": 20e-9, "common_mode_rejection": 60.0}
UA741 = replace(OPAMPS["ua741"], input_errors=True, offset_voltage=2e-3, **FIGURES)


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
        outputs=(Output("out", 1.0),),
        **dict.fromkeys(("matrices", "capacitors", "currents"), ()),
    )


def by_equations(circuit: Circuit) -> float:
    return LinearBoard(circuit).equilibrium["out"]


def by_ngspice(circuit: Circuit) -> float:
    (model,), one = circuit.models.values(), circuit.opamps[0]
    grounded = one.noninverting == GROUND
    subcircuit = opamp_subcircuit(model, noninverting_grounded=grounded, supply=15.0)
    pins = f"{one.noninverting} {one.inverting} {one.output}"
    cards = [".title one op-amp", str(subcircuit), f"Xone {pins} {one.model}"]
    cards += [f"R{r.name} {r.a} {r.b} {r.ohms!r}" for r in circuit.resistors]
    cards += [".options reltol=1e-9 abstol=1e-18 vntol=1e-12", ".save v(out)", ".op", ".end", ""]
    deck = SmallDeck("\n".join(cards), ("out",), OperatingPoint())
    return float(simulate(deck, find_simulator(), timeout=60.0)["out"][-1])


DIVIDER = (Resistor("in", "sum", GROUND, 1e4), Resistor("fb", "out", "sum", 9e4))
LEAK = Resistor("leak", "in", GROUND, 1e6)
REJECTING = {"bias_current": 100e-9, "common_mode_rejection": 60.0}
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
    "rejection": (part(**REJECTING), (LEAK,), True, -0.1 * (1.0 + 5e-4) / (1.0 - 5e-4)),
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
@pytest.mark.parametrize("resistors", [DIVIDER, DIVIDER[:1], (LEAK,)])
def test_whole_models_rest_alike(resistors: tuple[Resistor, ...], large_signal: bool) -> None:
    """Inverting, without feedback (its offset alone drives it beyond its swing), or following."""
    model = replace(UA741, large_signal=large_signal)
    circuit = bench(model, *resistors, follower=LEAK in resistors)
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


@pytest.mark.parametrize("sigmas", [1.5, -1.5])
def test_a_drawn_op_amp_has_its_deviations_from_the_mean(sigmas: float) -> None:
    typical = chosen()
    varying = dict(typical.varying)
    found = drawn(typical, dict.fromkeys(varying, sigmas))
    for name, each in varying.items():
        value, size = getattr(found, name), each.mean + sigmas * each.sigma
        if name == "common_mode_rejection":  # stated in dB, and its sign apart
            value = found.rejection_sign * 10.0 ** (-value / 20.0)
        assert value == pytest.approx(size, rel=1e-12)
    assert not found.varying


def changing(base: str, temperature: str, **opamp: Any) -> OpAmp:
    """An op-amp of a board for a range of temperatures, at supplies of ±15 V within 5 %."""
    choice = {"base": base, "input_errors": "typical", **opamp}
    design = {"opamp": choice, "temperature": temperature, "supply_tolerance": 0.05}
    return choose_opamp(make_scene(design=design))


def test_changes_that_a_sheet_lacks_are_named_and_those_of_a_scene_are_drawn() -> None:
    """That of the UA741 has the drift of the offset and the rejection of the supply."""
    assert changing("ua741", "0..70degC").not_known == ("bias_drift",)
    cold = changing("tl084", "5..25degC", input_errors="none", offset_drift="10uV/K")
    assert not cold.input_errors
    found = drawn(cold, {"offset_drift": 1.5})
    assert found.input_offset == pytest.approx(1.5 * 20.0 * 10e-6 / 0.67)


def test_currents_of_field_effect_inputs_are_four_times_as_large_20_kelvins_higher() -> None:
    """Of a TL084 at most 400 pA, typically 30 pA; of a current that a scene gives, that one."""
    drift = dict(changing("tl084", "25..45degC").varying)["bias_drift"]
    deviation = math.sqrt(4.0**2 - 1.0) * (400e-12 - 30e-12) / 3.0
    assert (drift.mean, drift.sigma) == pytest.approx((3.0 * 30e-12, deviation))
    given = changing("tl084", "25..45degC", input_errors="none", bias_current="1nA")
    ((name, own),) = given.varying
    assert (name, own.sigma) == ("bias_drift", 0.0)
    assert own.mean == pytest.approx(3e-9)


VENDOR = Path(__file__).parents[2] / "data" / "fet100.cir"
PINS, FILE = ("inp", "inn", "vcc", "vee", "out"), "fet100.opamp.json"
SCENE: dict[str, dict[str, Any]] = {
    "problem": {"kind": "tactile", "channels": 5, "span": 3.0},
    "design": {"capacitance": "100pF", "resistance": "1.9Mohm", "gain": "2Mohm"}
    | {"unit_conductance": "1uS", "stray_capacitance": "2pF", "opamp": {"file": FILE}},
    "analysis": {"initial": "rest"},
    "checks": {"settling_time": {"band": 0.01, "max": "1ms"}},
}


@pytest.fixture(scope="module")
def document(ngspice: str) -> dict[str, Any]:
    return to_document("fet100", import_opamp(str(VENDOR), "FET100", PINS, 15.0))


@pytest.fixture
def write(document: dict[str, Any], tmp_path: Path) -> Callable[..., Scene]:
    """Write scene and op-amp, both with changes, and read the scene."""

    def scene(changes: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Scene:
        (tmp_path / FILE).write_text(json.dumps(document | (changes or {})))
        data = {name: table | tables.get(name, {}) for name, table in SCENE.items()}
        return parse_scene(data, tmp_path / "scene.toml")

    return scene


def test_a_board_passes_with_the_vendors_netlist_in_the_deck(write: Callable[..., Scene]) -> None:
    verdict = verify(write())
    assert verdict.outcome is Outcome.PASS
    assert named(verdict, "engines_agree").value < 3e-4
    assert any("fet100 is imported" in warning for warning in verdict.warnings)
    assert "Xdevice" in str(taction.netlist(verdict.scene).to_pyspice())
    for dialect in ("ltspice", "hspice", "xyce", "spectre"):
        text = rf"design.opamp.file = 'fet100': .*not for {dialect}; expected a preset"
        with pytest.raises(InputError, match=text):
            taction.netlist(verdict.scene, dialect=dialect)


def test_both_engines_have_one_rest_with_offset(write: Callable[..., Scene]) -> None:
    board = LinearBoard(replace(synthesise(write()), currents=()))
    nodes = [output.node for output in board.circuit.outputs]
    deck = write_deck(board.circuit, OperatingPoint())
    assert "j.xdevice.j1 xdevice.11 inn xdevice.10 xdevice:jx" in deck.text
    with Simulation(deck, find_simulator(), timeout=60.0) as run:
        found = run.result().values[-1]
    np.testing.assert_allclose(found, [board.rest[node] for node in nodes], atol=1e-7)
    # The offset of 3.5 µV alone moves the board at rest.
    assert 1e-6 < max(abs(board.rest[node]) for node in nodes) < 1e-3


def test_without_a_linear_model_or_ngspice_nothing_is_decided(write: Callable[..., Scene]) -> None:
    verdict = verify(write({"linear": None, "missing": "no stable linear model"}))
    assert {check.outcome for check in verdict.checks} == {Outcome.INCONCLUSIVE}
    reason = "op-amp fet100 has no state-space witness: no stable linear model"
    assert all(check.reason.startswith(reason) for check in verdict.checks)
    verdict = verify(write().with_engine("statespace"))
    assert verdict.outcome is Outcome.INCONCLUSIVE
    assert "slew rate and limits of op-amp fet100 are in its netlist" in verdict.checks[0].reason


def test_the_onset_is_confirmed_by_the_netlist(write: Callable[..., Scene]) -> None:
    scene = write(problem={"channels": 2, "span": 1.0})
    (finding,) = onset(scene, over="C=0.3pF:4pF:3").findings
    assert finding.crossing.value == pytest.approx(1.2733e-12, rel=1e-3)
    assert finding.confirmed


@pytest.mark.parametrize(
    ("changes", "tables", "text"),
    [
        ({}, {"design": {"supply": 12.0}}, r"design.supply = ±12 V.*measured at ±15 V"),
        ({}, {"analysis": {"initial": "zero"}}, "analysis.initial.*expected 'rest'"),
        ({}, {"design": {"opamp": {"file": "x", "gbw": 1e6}}}, "'file' excludes 'gbw'"),
        ({}, {"design": {"opamp": {"file": "gone.json"}}}, "gone.json.*No such file"),
        ({"netlist": [".subckt m_fet100 a", ".options", ".ends"]}, {}, "card '.options'"),
        ({"pins": ["inp", "inn"]}, {}, "one role for each of the 5 ports"),
        ({"taction_opamp": 4}, {}, "taction_opamp = 4: expected 3"),
        ({"taction_opamp": 1, "linear": None}, {}, "= 1: expected 3; import the netlist again"),
        ({"figures": {}}, {}, "figures.dc_gain: missing; expected a file that `taction"),
        ({"supply": -15.0}, {}, "supply = -15.0: expected a number from 1e-30"),
        ({"name": "a b"}, {}, "name = 'a b': expected letters, digits"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(
    changes: dict[str, Any], tables: dict[str, Any], text: str, write: Callable[..., Scene]
) -> None:
    with pytest.raises(InputError, match=text):
        synthesise(write(changes, **tables))


def test_a_board_knows_the_measured_figures_or_has_them_alone(write: Callable[..., Scene]) -> None:
    cards, figures = (
        synthesise(write(design={"opamp": {"file": FILE, "model": model}}))
        for model in ("cards", "figures")
    )
    (vendor,), (macromodel,) = cards.models.values(), figures.models.values()
    assert synthesise(write()).models == cards.models
    assert vendor.slew_rate == pytest.approx(200e-6 / 15e-12, rel=0.03)  # its current into c2
    assert vendor.swing(15.0) == pytest.approx(13.5, rel=0.02)
    # Gates of JFETs: 15 pA of saturation, and gmin.
    assert 0.0 < vendor.bias_current < 100e-12
    assert vendor.offset_voltage == pytest.approx(3.5e-6, rel=0.2)
    assert not vendor.input_errors  # they are in the netlist
    assert vendor.imported is not None
    assert macromodel == replace(vendor, imported=None)
    assert macromodel.dc_gain == vendor.imported.figures.dc_gain
