"""The pipeline, end to end, on the shipped scenes and on what can go wrong with them."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import SimulatorNotFound, TimedOut
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.evidence.stress.catalogue import load_catalogue
from taction.verification.readings.settling import ChannelState
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.verdict_view import view
from taction.verification.stability.poles import Poles, poles
from taction.verification.verdict import board as board_module
from taction.verification.verdict import build as design
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.verify import Verdict, verify
from tests.support.paths import SCENES

NAMES = sorted(path.stem for path in SCENES.glob("*.toml"))
LINEAR = ["custom-matrix", "eleven-channel", "paper-breadboard", "tuned-breadboard"]


def shipped(name: str, **tables: dict[str, Any]) -> Scene:
    """A shipped scene with some keys of its tables changed."""
    file = SCENES / f"{name}.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return parse_scene(data | {k: data.get(k, {}) | v for k, v in tables.items()}, file)


@cache
def verdict_of(name: str, engine: str) -> Verdict:
    return verify(shipped(name, analysis={"engine": engine}))


def named(verdict: Verdict, name: str) -> Check:
    return next(check for check in verdict.checks if check.name == name)


def assert_named(verdict: Verdict, other: Verdict) -> None:
    """A verdict names simulator with version, solver and method, as text and as JSON."""
    found = find_simulator()
    names = [f"ngspice-{found.version}", "KLU" if found.klu else "Sparse", "trapezoidal"]
    document = verdict_document(verdict)
    assert [document[key] for key in ("simulator", "solver", "method")] == names
    assert f"{', '.join(names)}: " in page_text(view(verdict))
    method = "exact" if other.scene.design.amplifier == "linear" else "Radau IIA"
    assert f"statespace, {method}: " in page_text(view(other))


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", NAMES)
def test_every_shipped_scene_passes_with_both_engines(name: str) -> None:
    """One test a scene: its verdicts are computed once, whoever runs it."""
    verdict, other = verdict_of(name, "ngspice"), verdict_of(name, "statespace")
    for found in (verdict, other):
        outcomes = {check.name: check.outcome for check in found.checks}
        assert outcomes == dict.fromkeys(outcomes, Outcome.PASS)
        assert found.outcome is Outcome.PASS
    assert_named(verdict, other)
    agree = named(verdict, "engines_agree").value
    assert agree < 1e-3
    assert_same_measures(verdict, other)
    assert_budget_adds_up(verdict)
    if name in LINEAR:
        assert_tikhonov(verdict)


def assert_same_measures(verdict: Verdict, other: Verdict) -> None:
    for a in verdict.checks:
        if a.name in ("settling_time", "overshoot", "rise_time"):
            assert a.value == pytest.approx(named(other, a.name).value, rel=0.02)
    for left, right in zip(verdict.measurements.channels, other.measurements.channels, strict=True):
        assert left.final == pytest.approx(right.final, abs=1e-3 * verdict.measurements.amplitude)
        assert left.state is right.state is ChannelState.SETTLED


def assert_budget_adds_up(verdict: Verdict) -> None:
    parts = {part.name: part.value for part in verdict.budget if part.name != "noise"}
    stages = {"antilog"} if verdict.circuit.transistors else set()
    expected = {"regularisation", "strain_noise", "resistors", "opamps", "unsettled", "simulator"}
    if any(model.input_errors for model in verdict.circuit.models.values()):
        expected |= {"offset_voltage", "input_currents", "common_mode"}
    stages |= set() if verdict.scene.wires.ideal else {"wires"}
    assert set(parts) == expected | stages
    stress = verdict.problem.stress
    final = np.array([channel.final for channel in verdict.measurements.channels])
    whole = final - stress * verdict.circuit.value("U0")
    assert verdict.budget.summed == pytest.approx(whole.tolist(), rel=0.01, abs=1e-9)
    before = ("regularisation", "strain_noise")
    signed = [part for part in verdict.budget if part.channels and part.name not in before]
    errors = [np.array(part.channels) for part in signed]
    off = final - verdict.ideal.target
    assert sum(errors) == pytest.approx(off, rel=0.01, abs=1e-9)
    assert parts["resistors"] is not None
    assert parts["resistors"] < 1e-9  # exact ones


def assert_tikhonov(verdict: Verdict) -> None:
    """The reference, and the board, against a least-squares solver of the stacked system."""
    T, eps, lam = verdict.problem.matrix, verdict.problem.strain, verdict.circuit.value("lambda")
    stacked = np.vstack([T, math.sqrt(lam) * np.eye(T.shape[1])])
    wanted = np.linalg.lstsq(stacked, np.append(eps, np.zeros(T.shape[1])), rcond=None)[0]
    wanted *= verdict.circuit.value("U0")
    assert verdict.ideal.target == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    final = np.array([channel.final for channel in verdict.measurements.channels])
    assert np.max(np.abs(final - wanted)) < 1e-3 * np.max(np.abs(wanted))


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("engine", ["ngspice", "statespace"])
def test_half_the_capacitance_oscillates(engine: str) -> None:
    scene = shipped("paper-breadboard", design={"capacitance": "5pF"}, analysis={"engine": engine})
    verdict = verify(scene)
    assert verdict.outcome is Outcome.FAIL
    pole = verdict.poles.rightmost
    assert pole.real > 0
    for channel in verdict.measurements.channels:
        assert channel.state is ChannelState.OSCILLATING
        assert channel.settling_time is None
        assert channel.frequency == pytest.approx(pole.imag / (2 * math.pi), rel=2e-3)
        assert channel.growth_rate == pytest.approx(pole.real, rel=0.02)
    assert "oscillates at 37.9 kHz, growth rate +7.865 k/s" in named(verdict, "stability").reason
    assert "every channel oscillating at 37.9" in named(verdict, "steady_state").reason


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("G0", [1e-12, 1e-3])
def test_the_scale_of_the_conductances_does_not_matter(G0: float) -> None:
    """The tuned board with every admittance in proportion: the same waveforms in the same time."""
    tuned = shipped("tuned-breadboard")
    k = G0 / tuned.design.unit_conductance
    opamp = {
        "base": "ideal", "dc_gain": 1e5, "gbw": "1.38MHz", "second_pole": "4.14MHz",
        "output_resistance": 75.0 / k,
    }  # fmt: skip
    scene = shipped(
        "tuned-breadboard",
        design={
            "unit_conductance": G0, "resistance": 14.4e6 / k, "gain": 2.3e6 / k,
            "capacitance": 10e-12 * k, "stray_capacitance": 2.05e-12 * k,
            "inverter_resistance": tuned.design.inverter_resistance / k, "opamp": opamp,
        },
    )  # fmt: skip
    verdict, wanted = verify(scene), verdict_of("tuned-breadboard", "ngspice")
    assert verdict.outcome is Outcome.PASS
    for name in ("settling_time", "overshoot"):
        assert named(verdict, name).value == pytest.approx(named(wanted, name).value, rel=1e-3)
    assert named(verdict, "steady_state").value == pytest.approx(
        named(wanted, "steady_state").value, rel=0.02
    )


def test_an_untrusted_reference_is_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    original = board_module.ideal_answer

    def doubted(*args: Any) -> IdealAnswer:
        return replace(original(*args), problem="the certificate is above its bound")

    monkeypatch.setattr(board_module, "ideal_answer", doubted)
    verdict = verify(shipped("tuned-breadboard", analysis={"engine": "statespace"}))
    assert verdict.outcome is Outcome.INCONCLUSIVE
    assert named(verdict, "steady_state").outcome is Outcome.INCONCLUSIVE
    assert named(verdict, "stability").outcome is Outcome.PASS


def test_without_ngspice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    with pytest.raises(SimulatorNotFound, match="/nowhere/ngspice"):
        verify(shipped("tuned-breadboard", analysis={"engine": "ngspice"}))
    verdict = verify(shipped("tuned-breadboard", analysis={"engine": "auto"}))
    assert verdict.outcome is Outcome.PASS
    assert verdict.waveforms.engine.startswith("statespace")


@pytest.mark.usefixtures("ngspice")
def test_a_simulation_out_of_time() -> None:
    scene = shipped("paper-breadboard", analysis={"engine": "ngspice", "timeout": "10ms"})
    with pytest.raises(TimedOut, match=r"0\.01 s"):
        verify(scene)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return next(case for case in load_catalogue() if case.name == "onset-itself").scene()


def shifted(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """Move the rightmost pair of poles by a share of its rounding error."""

    def moved(board: LinearBoard) -> Poles:
        found = poles(board)
        values = found.poles.copy()
        values[:2] = share * found.errors[:2] + 1j * values[:2].imag
        rightmost = complex(values[0].real, abs(values[0].imag))
        return replace(found, poles=values, rightmost=rightmost)

    monkeypatch.setattr(design, "poles", moved)


@pytest.mark.parametrize("engine", ["statespace", "ngspice"])
def test_the_verdict_is_the_same(
    scene: Scene, engine: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    if engine == "ngspice":
        request.getfixturevalue("ngspice")
    asked = scene.model_copy(
        update={"analysis": scene.analysis.model_copy(update={"engine": engine})}
    )
    outcomes = []
    for share in (-0.5, 0.5):
        shifted(monkeypatch, share)
        outcomes.append({c.name: c.outcome.value for c in verify(asked).checks})
    assert outcomes[0] == outcomes[1]
    assert outcomes[0]["stability"] == "inconclusive"
