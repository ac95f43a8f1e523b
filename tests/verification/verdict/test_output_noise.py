"""Noise of the outputs: both engines, its bands, the check, the report and the error budget."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import NoiseAnalysis
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.verification.engines.ngspice.evidence import integrated_noise
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.verdict_view import view
from taction.verification.verdict.board import OutputNoise, noise_bands
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.mutation.planting import CircuitChange, figures, scaled
from tests.support.measured import check, evidence, named
from tests.support.paths import SCENES

TYPICAL = {"design.opamp.voltage_noise": 20e-9, "design.opamp.current_noise": 0.5e-12}
OPEN = {"base": "ideal", "gbw": "10MHz", "output_resistance": "75ohm"}


def from_ngspice(board: LinearBoard, channel: int) -> float:
    bands = noise_bands(board.state_space.modes.poles)
    deck = write_deck(
        board.circuit, NoiseAnalysis(bands), saved=[board.circuit.outputs[channel].node]
    )
    with Simulation(deck, find_simulator(), timeout=60.0) as run:
        return run.accept(integrated_noise)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    "name", ["custom-matrix", "box", "inverse", "paper-exponential", "paper-exponential-devices"]
)
def test_both_engines_find_the_noise_of_shipped_scenes(name: str) -> None:
    """Linear and exponential, the latter at the equilibrium; the loudest and the first channel."""
    scene = resolve_lambda(with_values(load_scene(SCENES / f"{name}.toml"), TYPICAL))
    board = LinearBoard(synthesise(scene, make_problem(scene)))
    rms, error = output_noise(board)
    assert (error <= 0.01 * rms).all()  # both are 0 where an amplifier's output cannot move
    for channel in {int(np.flatnonzero(rms)[0]), int(rms.argmax())}:
        assert from_ngspice(board, channel) == pytest.approx(rms[channel], rel=1e-3)


def small(amplifier: str = "linear", checks: dict[str, Any] | None = None, **design: Any) -> Scene:
    parts = {"capacitance": "1nF", "lambda": 0.2, "gain": "100kohm", "opamp": "tl084"}
    parts |= {"unit_conductance": "10uS", "amplifier": amplifier, **design}
    matrix = [[1.0, 0.3], [-0.2, 0.8]]
    return Scene.from_arrays(matrix, [0.6, 0.4], design=parts, checks=checks or {})


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(("corner", "lowest"), [("1kHz", "0.1Hz"), ("1MHz", "10Hz"), (0, "20kHz")])
def test_both_engines_agree_on_a_band(corner: str, lowest: str) -> None:
    """Where 1/f noise is most of the noise, and where white noise below the band counts."""
    design = {
        "opamp": {"base": "tl084", "voltage_noise": "1uV/rtHz", "voltage_noise_corner": corner}
    }
    scene = small(checks={"noise": {"max": "1V", "lowest": lowest}}, **design)
    verdict = verify(scene.with_engine("ngspice"))
    check = named(verdict, "noise")
    assert verdict.noise.difference < 1e-3 * check.value
    assert "above" in check.reason
    assert ("1/f" in check.reason) is (corner != 0)
    if corner == "1MHz":
        assert check.value > 2.0 * output_noise(LinearBoard(synthesise(small())))[0].max()


def test_the_lowest_frequency_is_stated() -> None:
    """By default that of data sheets where an op-amp has 1/f noise; the key replaces it."""

    def found(opamp: Any, **keys: Any) -> OutputNoise:
        scene = small(checks={"noise": {"max": "1mV"} | keys}, opamp=opamp)
        return verify(scene.with_engine("statespace")).noise

    assert found("op27").band == "above 100 mHz, with 1/f noise"
    assert found("op27", lowest="2Hz").band == "above 2 Hz, with 1/f noise"
    silenced = found({"base": "op27", "voltage_noise_corner": 0})
    assert silenced.band == "over all frequencies"
    assert found("op27").largest > silenced.largest
    assert "1/f noise of op-amp ua741 not known" in found("ua741").notes[0]


@pytest.mark.parametrize(
    ("rms", "simulated", "lacking", "outcome", "reason"),
    [
        (0.9e-3, None, "", Outcome.PASS, "channel 2"),
        (1.1e-3, None, "", Outcome.FAIL, "channel 2"),
        (1.0e-3, None, "", Outcome.INCONCLUSIVE, "channel 2"),
        (0.9e-3, 0.905e-3, "", Outcome.PASS, "channel 2"),
        (0.997e-3, 1.002e-3, "", Outcome.INCONCLUSIVE, "channel 2"),
        (0.9e-3, 0.88e-3, "", Outcome.INCONCLUSIVE, "ngspice differs by 2.22 %"),
        (1.5e-3, 1.6e-3, "", Outcome.INCONCLUSIVE, "ngspice differs by 6.67 %"),
        (0.9e-3, None, "of mine", Outcome.INCONCLUSIVE, "of mine"),
        (1.1e-3, None, "of mine", Outcome.FAIL, "channel 2"),
    ],
)
def test_the_check(
    rms: float, simulated: float | None, lacking: str, outcome: Outcome, reason: str
) -> None:
    noise = OutputNoise((1e-6, rms), (1e-9, 1e-9), "", simulated, lacking)
    found = check("noise", evidence(checks={"noise": {"max": 1e-3}}, noise=noise))
    assert found.outcome is outcome
    assert reason in found.reason
    assert (found.value, found.unit, found.expected) == (rms, "V", 1e-3)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("engine", ["ngspice", "statespace"])
def test_the_verdict_has_the_noise_of_every_channel(engine: str) -> None:
    scene = small(checks={"noise": {"max": "1mV"}}).with_engine(engine)
    verdict = verify(scene)
    rms = output_noise(LinearBoard(synthesise(scene)))[0]
    check = named(verdict, "noise")
    assert check.outcome is Outcome.PASS
    assert check.value == pytest.approx(rms.max(), rel=1e-9)
    document = verdict_document(verdict)
    assert document["noise"]["rms"] == pytest.approx(rms.tolist(), rel=1e-9)
    assert (document["noise"]["ngspice"] is None) is (engine == "statespace")
    assert document["error_budget"]["noise"]["value"] == pytest.approx(rms.max(), rel=1e-9)
    assert "noise" in page_text(view(verdict))


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("volts", "amps", "fault"),
    [
        ("50nV/rtHz", "0.1pA/rtHz", figures(voltage_noise=40e-9)),
        ("50nV/rtHz", "0.1pA/rtHz", figures(gbw=2e6)),
        ("5nV/rtHz", "20pA/rtHz", figures(current_noise=15e-12)),
        ("5nV/rtHz", "20pA/rtHz", scaled("noises", "eps_", density=0.9)),
        ("1nV/rtHz", "0.01pA/rtHz", scaled("capacitors", "c_", farads=1.05)),
        ("1nV/rtHz", "0.01pA/rtHz", scaled("resistors", "r_", ohms=0.5)),
    ],
)
def test_a_fault_in_the_deck_alone_is_no_pass(
    volts: str, amps: str, fault: CircuitChange, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = {"base": "tl084", "voltage_noise": volts, "current_noise": amps}
    design = {"opamp": model, "sensor_noise": amps}
    scene = small(checks={"noise": {"max": "1mV"}}, **design).with_engine("ngspice")
    assert named(verify(scene), "noise").outcome is Outcome.PASS
    writer = "taction.verification.verdict.board.write_deck"
    monkeypatch.setattr(
        writer, lambda board, *rest, **more: write_deck(fault(board), *rest, **more)
    )
    check = named(verify(scene), "noise")
    assert check.outcome is Outcome.INCONCLUSIVE
    assert "ngspice differs by" in check.reason


@pytest.mark.parametrize(
    ("design", "reason"),
    [
        ({"topology": "passive", "gain": "1Mohm", "opamp": OPEN}, "has no limit of its bandwidth"),
        ({"capacitance": "1fF", "stray_capacitance": "1nF"}, "an unstable board has no noise"),
    ],
)
def test_a_board_whose_noise_has_no_bound_is_undecided(design: dict[str, Any], reason: str) -> None:
    scene = small(checks={"noise": {"max": "1mV"}}, **design).with_engine("statespace")
    verdict = verify(scene)
    check = named(verdict, "noise")
    assert check.outcome is Outcome.INCONCLUSIVE
    assert reason in check.reason
    assert next(part for part in verdict.budget if part.name == "noise").value is None
