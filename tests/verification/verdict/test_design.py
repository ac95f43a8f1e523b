"""Op-amps with slew rate and swing: both engines, closed forms, and the level of a board."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import GROUND, Circuit, Output
from taction.netlist_gen.board.parts import CurrentSource, OpAmpCell, Resistor
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import KNEE
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.system.progress import Clock
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice.process import find_simulator
from taction.verification.engines.ngspice.process import simulate as by_ngspice
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients.simulate import simulate as by_state_space
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.views.checks import check_bar
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.deck import deck_of
from taction.verification.verdict.design import design_board
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene
from tests.support.paths import CASES, SCENES
from tests.support.small_decks import transient

STEP = 100e-6  # A
OHMS = 1e5


def stage(supply: float = 15.0) -> Circuit:
    """One inverting uA741 with 100 kohm of feedback: a current of 100 uA asks for -10 V."""
    board = deck_of(load_scene(SCENES / "custom-matrix.toml"))[0]
    return replace(
        board,
        models={"ua741": replace(OPAMPS["ua741"], large_signal=True)},
        opamps=(OpAmpCell("one", "ua741", GROUND, "sum", "amp"),),
        resistors=(Resistor("f", "amp", "sum", OHMS), Resistor("g", "sum", GROUND, 1e4)),
        matrices=(),
        capacitors=(),
        currents=(CurrentSource("step", "sum", STEP),),
        outputs=(Output("amp", 1.0),),
        supply=supply,
    )


def both(supply: float, stop: float) -> tuple[Waveforms, Waveforms]:
    circuit, times = stage(supply), np.linspace(0.0, stop, 2001)
    exact = by_state_space(LinearBoard(circuit), Transient(stop, stop / 2000), times=times)
    model = circuit.models["ua741"]
    cell = opamp_subcircuit(model, noninverting_grounded=True, supply=supply)
    cards = [*str(cell).splitlines(), "Xone 0 sum amp ua741"]
    cards += [f"Rf amp sum {OHMS!r}", "Rg sum 0 10000.0", f"Istep 0 sum {STEP!r}"]
    deck = transient(*cards, saved=("amp",), stop=stop, step=stop / 20_000)
    return exact, by_ngspice(deck, find_simulator(), timeout=60.0)


@pytest.mark.usefixtures("ngspice")
def test_an_output_slews_at_the_slew_rate() -> None:
    # 10 V at 0.5 V/us take 20 us; over the first 5 V the input is above 6 times its range.
    for wave in both(15.0, 60e-6):
        out = wave["amp"]
        ramp = (wave.time > 4e-6) & (wave.time < 10e-6)
        slope = np.polyfit(wave.time[ramp], out[ramp], 1)[0]
        assert slope == pytest.approx(-0.5e6, rel=2e-3)
        assert out[-1] == pytest.approx(-STEP * OHMS, rel=2e-3)
    exact, simulated = both(15.0, 60e-6)
    apart = np.interp(exact.time, simulated.time, simulated["amp"]) - exact["amp"]
    assert float(np.abs(apart).max()) < 1e-4 * STEP * OHMS


@pytest.mark.usefixtures("ngspice")
def test_an_output_stops_at_its_swing() -> None:
    # At ±10 V a uA741 reaches 9 V. With -10 V asked the input stays overdriven, and the clamp draws
    # what the input stage gives:
    # tanh((x - 9)/d) + tanh((x + 9)/d) = s with s = tanh(v/V), d = 9/50.
    model = OPAMPS["ua741"]
    for wave in both(10.0, 120e-6):
        out = float(wave["amp"][-1])
        v_in = (STEP + out / OHMS) / (1.0 / OHMS + 1e-4 + 0.5e-6)  # feedback, 10 kohm, 2 Mohm
        drawn = math.tanh(v_in / model.input_range)
        first_pole = 9.0 + 9.0 / KNEE * math.atanh(drawn - 1.0)
        assert -out == pytest.approx(first_pole, rel=1e-3)
        assert 8.5 < -out < 9.0


@pytest.mark.usefixtures("ngspice")
def test_an_output_gives_its_largest_current() -> None:
    """Into 100 ohm 20 mA are 2 V; the board asks for 10 V."""
    loaded = replace(
        stage(), resistors=(*stage().resistors, Resistor("load", "amp", GROUND, 100.0))
    )
    model = replace(loaded.models["ua741"], limits_current=True, output_current=20e-3)
    loaded, stop = replace(loaded, models={"ua741": model}), 60e-6
    times = np.linspace(0.0, stop, 2001)
    exact = by_state_space(LinearBoard(loaded), Transient(stop, stop / 2000), times=times)
    cell = opamp_subcircuit(model, noninverting_grounded=True, supply=15.0)
    cards = [*str(cell).splitlines(), "Xone 0 sum amp ua741", "Rload amp 0 100.0"]
    cards += [f"Rf amp sum {OHMS!r}", "Rg sum 0 10000.0", f"Istep 0 sum {STEP!r}"]
    deck = transient(*cards, saved=("amp",), stop=stop, step=stop / 20_000)
    simulated = by_ngspice(deck, find_simulator(), timeout=60.0)
    for wave in (exact, simulated):
        assert wave["amp"][-1] == pytest.approx(-20e-3 * 100.0, rel=2e-3)
    apart = np.interp(exact.time, simulated.time, simulated["amp"]) - exact["amp"]
    assert float(np.abs(apart).max()) < 1e-4 * 2.0


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
