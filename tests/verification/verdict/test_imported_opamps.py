"""The chain of an imported op-amp: netlist, import, scene, verdict."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.imported_opamps import to_document
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import InputError
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.studies.decks.vendor_model import import_opamp
from taction.verification.studies.onset.onset import onset
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify

VENDOR = Path(__file__).parents[2] / "data" / "fet100.cir"
PINS = ("inp", "inn", "vcc", "vee", "out")
SCENE = """
name = "imported"
[problem]
kind = "tactile"
channels = 5
span = 3.0
[design]
capacitance = "100pF"
resistance = "1.9Mohm"
gain = "2Mohm"
unit_conductance = "1uS"
stray_capacitance = "2pF"
opamp = { file = "fet100.opamp.json" }
[analysis]
initial = "rest"
[checks]
settling_time = { band = 0.01, max = "1ms" }
"""


@pytest.fixture(scope="module")
def document(ngspice: str) -> dict[str, Any]:
    return to_document("fet100", import_opamp(str(VENDOR), "FET100", PINS, 15.0))


@pytest.fixture
def write(document: dict[str, Any], tmp_path: Path) -> Callable[..., Scene]:
    """Write scene and op-amp, both with changes, and read the scene."""

    def scene(changes: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Scene:
        (tmp_path / "fet100.opamp.json").write_text(json.dumps(document | (changes or {})))
        path = tmp_path / "scene.toml"
        path.write_text(SCENE)
        data = load_scene(path).model_dump(by_alias=True, exclude_unset=True)
        for table, values in tables.items():
            data[table] |= values
        return parse_scene(data, path)

    return scene


def test_a_board_passes_with_the_vendors_netlist_in_the_deck(write: Callable[..., Scene]) -> None:
    verdict = verify(write())
    assert verdict.outcome is Outcome.PASS
    (agree,) = (check for check in verdict.checks if check.name == "engines_agree")
    assert agree.value < 3e-4
    assert any("fet100 is imported" in warning for warning in verdict.warnings)


@pytest.mark.parametrize("dialect", ["ltspice", "hspice", "xyce", "spectre"])
def test_a_vendors_netlist_is_for_ngspice_only(dialect: str, write: Callable[..., Scene]) -> None:
    text = rf"design.opamp.file = 'fet100': .*not for {dialect}; expected a preset"
    with pytest.raises(InputError, match=text):
        taction.netlist(write(), dialect=dialect)
    assert "Xdevice" in str(taction.netlist(write()).to_pyspice())


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


def test_without_a_linear_model_nothing_is_decided(write: Callable[..., Scene]) -> None:
    verdict = verify(write({"linear": None, "missing": "no stable linear model"}))
    assert {check.outcome for check in verdict.checks} == {Outcome.INCONCLUSIVE}
    reason = "op-amp fet100 has no state-space witness: no stable linear model"
    assert all(check.reason.startswith(reason) for check in verdict.checks)


def test_without_ngspice_nothing_is_decided(write: Callable[..., Scene]) -> None:
    verdict = verify(write().with_engine("statespace"))
    assert verdict.outcome is Outcome.INCONCLUSIVE
    assert "slew rate and limits of op-amp fet100 are in its netlist" in verdict.checks[0].reason


def test_the_onset_is_confirmed_by_the_netlist(write: Callable[..., Scene]) -> None:
    scene = write(problem={"channels": 2, "span": 1.0})
    (finding,) = onset(scene, over="C=0.3pF:4pF:3").findings
    assert finding.crossing.value == pytest.approx(1.2733e-12, rel=1e-3)
    assert finding.confirmation.confirmed


@pytest.mark.parametrize(
    ("changes", "tables", "text"),
    [
        ({}, {"design": {"supply": 12.0}}, r"design.supply = ±12 V.*measured at ±15 V"),
        ({}, {"analysis": {"initial": "zero"}}, "analysis.initial.*expected 'rest'"),
        ({}, {"design": {"opamp": {"file": "x", "gbw": 1e6}}}, "'file' excludes 'gbw'"),
        ({}, {"design": {"opamp": {"file": "gone.json"}}}, "gone.json.*No such file"),
        (
            {"netlist": [".subckt m_fet100 a", ".options", ".ends"]},
            {},
            "card '.options'",
        ),
        ({"pins": ["inp", "inn"]}, {}, "one role for each of the 5 ports"),
        ({"taction_opamp": 4}, {}, "taction_opamp = 4: expected 3"),
        ({"taction_opamp": 1, "linear": None}, {}, "of an older version; import the netlist again"),
        (
            {"figures": {}},
            {},
            "figures.dc_gain: missing; expected a file that `taction",
        ),
        ({"supply": "15"}, {}, "supply = '15': expected a finite number"),
        ({"supply": 10**400}, {}, "supply = an integer of over 300 digits: expected"),
        ({"supply": -15.0}, {}, "supply = -15.0: expected a number from 1e-30"),
        ({"netlist": None}, {}, "netlist = null: expected a list"),
        ({"linear": 3}, {}, "linear = 3: expected a table"),
        ({"name": "a b"}, {}, "name = 'a b': expected letters, digits"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(
    changes: dict[str, Any], tables: dict[str, Any], text: str, write: Callable[..., Scene]
) -> None:
    with pytest.raises(InputError, match=text):
        synthesise(write(changes, **tables))


def test_a_board_knows_the_measured_limits_and_errors(write: Callable[..., Scene]) -> None:
    (model,) = synthesise(write()).models.values()
    assert model.slew_rate == pytest.approx(200e-6 / 15e-12, rel=0.03)  # its current into c2
    assert model.swing(15.0) == pytest.approx(13.5, rel=0.02)
    # Gates of JFETs: 15 pA of saturation, and gmin.
    assert 0.0 < model.bias_current < 100e-12
    assert model.offset_voltage == pytest.approx(3.5e-6, rel=0.2)
    assert not model.input_errors  # they are in the netlist


def test_a_scene_takes_the_measured_figures_where_it_says_so(write: Callable[..., Scene]) -> None:
    cards, figures = (
        synthesise(write(design={"opamp": {"file": "fet100.opamp.json", "model": model}}))
        for model in ("cards", "figures")
    )
    (vendor,), (macromodel,) = cards.models.values(), figures.models.values()
    assert vendor.imported is not None
    assert macromodel == replace(vendor, imported=None)
    assert macromodel.dc_gain == vendor.imported.figures.dc_gain
