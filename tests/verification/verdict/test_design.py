"""Op-amps with slew rate and swing: both engines, closed forms, and the level of a board."""

from __future__ import annotations

import math

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.progress import Clock
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.views.checks import check_bar
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.design import design_board
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene
from tests.support.paths import CASES, SCENES


def built(scene: Scene, level: str = "auto") -> LinearBoard:
    scene = with_values(scene, {"design.opamp.level": level})
    return design_board(scene, Clock(lambda stage: None)).board


def test_the_level_changes_neither_the_equilibrium_nor_the_poles() -> None:
    scene = load_scene(CASES / "slew-ua741.toml")
    one, other = built(scene, "small-signal"), built(scene)
    assert one.circuit.is_linear
    assert not other.circuit.is_linear
    for output in one.circuit.outputs:
        ends = (board.equilibrium[output.node] for board in (one, other))
        assert next(ends) == pytest.approx(next(ends), abs=1e-9)
    lead = (board.state_space.modes.poles[0] for board in (one, other))
    assert next(lead) == pytest.approx(next(lead), rel=1e-6)


def named(verdict: Verdict, name: str) -> Check:
    return next(check for check in verdict.checks if check.name == name)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("volts", [1.0, 8.0])
def test_both_engines_agree_on_a_board_that_slews_and_clips(volts: float) -> None:
    """At U0 = 1 V op-amps slew, at 8 V they reach 14 V on the way, too."""
    changes = {"design.unit_voltage": volts, "analysis.error": 5e-5}
    scene = with_values(load_scene(CASES / "slew-ua741.toml"), changes)
    verdict = verify(scene.with_engine("ngspice"))
    agree, headroom = named(verdict, "engines_agree"), named(verdict, "headroom")
    assert (verdict.outcome, agree.outcome) == (Outcome.PASS, Outcome.PASS)
    assert agree.value < 1e-4
    assert "needs 1.58 V/us of 0.5;" in headroom.reason or volts > 1.0
    document = verdict_document(verdict)
    assert document["opamp_level"] == "large-signal"
    assert document["headroom"][0]["share"] == pytest.approx(3.164 * volts, rel=2e-3)


def test_a_headroom_says_how_long_an_op_amp_slews() -> None:
    """``d sinh(v / V) / dt = -sinh(v / V) / tau`` of an inverter, V the range of its input."""
    rate, range_, volts = 2.0 * math.pi * 1e6, 1.0 / (2.0 * math.pi), 8.0  # of 1 V/us
    part = {"base": "ideal", "dc_gain": 1e7, "gbw": "1MHz", "slew_rate": "1V/us"}
    design = {"topology": "inv", "strain_input": "voltage", "unit_voltage": "10V", "opamp": part}
    design |= {"unit_conductance": "100uS", "stray_capacitance": 0.0}
    verdict = verify(Scene.from_arrays([[1.0]], [volts / 10.0], design=design))
    start = 0.5 * volts / range_  # half of the step reaches the input
    expected = 2.0 / rate * math.log(math.sinh(start) / math.sinh(1.0))
    (load,) = verdict.parts.simulated
    assert load.slewing == pytest.approx(expected, rel=0.02)
    assert load.peak == pytest.approx(0.5 * volts * rate, rel=1e-3)
    check = named(verdict, "headroom")
    assert check.reason.startswith("slews for 7.7 us: needs 25.1 V/us of 1; op-amp v_1")
    assert check_bar(check).value == "slews for 7.7 µs: needs 25.1 V/µs of 1"
    assert check_bar(check).share is None  # no other load hides it


def test_slewing_makes_a_board_settle_later() -> None:
    scene = load_scene(CASES / "slew-ua741.toml").with_engine("statespace")
    slow = verify(scene).measurements.settling_time
    quick = verify(with_values(scene, {"design.opamp.level": "small-signal"}))
    assert quick.outcome is Outcome.INCONCLUSIVE
    assert slow.value > quick.measurements.settling_time.value + 1e-5


def test_a_board_within_its_limits_stays_linear() -> None:
    scene = load_scene(SCENES / "custom-matrix.toml")
    assert built(scene).circuit.is_linear
    assert not built(scene, "large-signal").circuit.is_linear


def beyond_limits(channels: int, **figures: str) -> Scene:
    design = {"opamp": {"base": "ua741", **figures}, "capacitance": "100pF", "lambda": 1.0}
    design |= {"gain": "1Mohm", "unit_conductance": "1uS", "unit_voltage": "5V"}
    return make_scene({"channels": channels, "span": 6.0 * channels / 7}, design=design)


FOLLOWERS = {"topology": "passive", "opamp": "ua741", "capacitance": "1nF", "lambda": 10.0}
AMPLIFIED = {"amplifier": "exponential", "exponential_slope": "0.1V", "capacitance": "100pF"}
AMPLIFIED |= {"lambda": 0.2, "gain": "100kohm", "unit_conductance": "10uS", "opamp": "ua741"}
# The scene, and what the headroom says.
SLEWING = {
    "followers": (make_scene(design=FOLLOWERS | {"unit_voltage": "5V"}), ""),
    "a current": (beyond_limits(3, output_current="0.25mA"), "and largest output current"),
    "many unknowns": (beyond_limits(5), "slew rate and swing"),
    "amplifiers": (
        Scene.from_arrays([[1.0, 0.4], [0.3, 0.9]], [0.7, 0.5], design=AMPLIFIED),
        "slews for",
    ),
}


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", SLEWING)
def test_both_engines_agree_on_every_kind_of_board_that_slews(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "many unknowns":  # solved through its structure
        monkeypatch.setattr(descriptor, "LARGE", 100)
    scene, reason = SLEWING[name]
    verdict = verify(with_values(scene, {"analysis.error": 5e-5}).with_engine("ngspice"))
    agree = named(verdict, "engines_agree")
    assert not verdict.circuit.is_small_signal
    assert reason in named(verdict, "headroom").reason
    assert agree.outcome is Outcome.PASS
    assert agree.value < 1e-4
