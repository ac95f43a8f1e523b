"""Loads and power of op-amps, and boards at the limits of their op-amps, by both engines."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.verification.engines.ngspice.process import find_simulator, simulate
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.verdict.board import Board
from taction.verification.verdict.board_files import board_power
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.headroom import Load, PartLoads
from taction.verification.verdict.simulation import _statespace_error, begin, build
from taction.verification.verdict.verify import verify
from tests.support import nightly
from tests.support.making import NEAR_IDEAL, make_scene, matrix_problem
from tests.support.measured import named
from tests.support.paths import CASES, SCENES


def loads_of(design: Board) -> tuple[Load, ...]:
    return PartLoads.of(design.linear, design.transient).loads


def worst(loads: tuple[Load, ...], quantity: str) -> Load:
    return next(load for load in loads if load.quantity == quantity)


# Two channels, whose loads are of several per cent.
EXPONENTIAL = Scene.from_arrays(
    [[1.0, 0.3], [-0.2, 0.8]], [0.6, -0.4], capacitance="1nF", lam=0.2, gain="100kohm",
    unit_conductance="10uS", amplifier="exponential", exponential_slope="0.3V",
    opamp={"base": "tl084", "level": "small-signal"},
)  # fmt: skip


def small_signal(name: str) -> Scene:
    scene = load_scene(CASES / f"{name}.toml")
    return with_values(scene, {"design.opamp.level": "small-signal"})


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    "scene",
    [load_scene(SCENES / "custom-matrix.toml"), small_signal("slew-ua741"), EXPONENTIAL],
)
def test_peaks_are_those_of_ngspice(scene: Scene) -> None:
    design = build(scene)
    loads = loads_of(design)
    nodes = {cell.name: cell.output for cell in design.circuit.opamps}
    stop = 20.0 * worst(loads, "voltage").at
    simulator, saved = find_simulator(), tuple(nodes.values())
    analysis = Transient(stop, stop / 20_000)
    deck = write_deck(design.circuit, analysis, solver=simulator.solver_option, saved=saved)
    wave = simulate(deck, simulator, timeout=60.0)
    slopes = np.gradient(wave.values, wave.time, axis=0)
    for quantity, values in (("voltage", wave.values), ("slope", slopes)):
        found = worst(loads, quantity)
        peak = float(np.abs(values).max())
        assert found.peak == pytest.approx(peak, rel=5e-3, abs=found.error)
        own = np.abs(values[:, wave.nodes.index(nodes[found.part])])
        assert float(own.max()) == pytest.approx(peak, rel=1e-2)  # mirrored channels are alike
        assert found.at == pytest.approx(float(wave.time[own.argmax()]), rel=0.2)


def test_loads_and_record_by_steps_are_of_one_integration(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, prepare = list[stepped.Task](), stepped.SteppedCurve.of

    def counted(task: stepped.Task) -> stepped.SteppedCurve:
        begun.append(task)
        return prepare(task)

    monkeypatch.setattr(stepped.SteppedCurve, "of", counted)
    design = build(EXPONENTIAL.with_engine("statespace"))
    assert not design.circuit.is_linear
    assert design.loads.loads
    record = begin(design)()
    assert len(begun) == 1
    assert _statespace_error(design, record).volts < design.volts(design.plan.wanted)
    assert len(begun) == 2


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("engine", ["ngspice", "statespace"])
@pytest.mark.parametrize(
    ("name", "outcome", "share", "part"),
    [
        # What cannot rest: u U0 of the numerical solution over the swing; else 1.58 V/us of 0.5.
        ("slew", Outcome.FAIL, 0.8810450930351755 * 30.0 / 14.0, "v_5"),
        ("slew-ua741", Outcome.INCONCLUSIVE, 3.164, "c_6"),
        ("impossible-volts", Outcome.FAIL, 1.0517357848110416 * 1e6 / 13.5, "v_2"),
    ],
)
def test_a_board_whose_parts_cannot_do_it_never_passes(
    name: str, engine: str, outcome: Outcome, share: float, part: str
) -> None:
    verdict = verify(small_signal(name).with_engine(engine))
    check = named(verdict, "headroom")
    assert (verdict.outcome, check.outcome) == (outcome, outcome)
    assert check.value == pytest.approx(share, rel=2e-3)
    assert 0.0 <= check.uncertainty < 1e-2 * check.value
    assert f"op-amp {part} " in check.reason
    assert "a smaller unit_voltage lowers it" in check.reason


def test_one_channel_by_hand() -> None:
    """The output is 1 V at v_1, -1 V at a_1 and -0.5 V at w_1: eps = 3, T = 1, lambda = 0.5.

    v_1 drives R = 2 Mohm and an inverter, a_1 is loaded by the inverter and T, w_1 by s and T.
    """
    design = {"lambda": 0.5, "gain": "1Mohm", "unit_conductance": "1uS", "unit_voltage": 0.5}
    opamp = NEAR_IDEAL | {"supply_current": "1mA"}
    opamp |= {"output_resistance": "10ohm", "output_current": "1mA"}
    scene = make_scene(design=design | {"supply": "±10V", "opamp": opamp})
    linear = LinearBoard(synthesise(scene, matrix_problem([[1.0]], [3.0])))
    power = board_power(linear)
    v, a, w = 100.5e-6, 101e-6, 1e-6
    quiescent, outputs = 3 * 20 * 1e-3, 9.0 * v + 9.0 * a + 9.5 * w
    resistors = 0.5e-6 + 200e-6 + 1e-6 + 0.5e-6
    assert power.total == pytest.approx(quiescent + outputs + resistors, rel=1e-9)
    assert power.supply_current == pytest.approx(3e-3 + a + w, rel=1e-9)
    load = worst(PartLoads.of(linear, Transient(1e-3, 1e-6)).loads, "current")
    assert (load.part, load.rest) == ("a_1", pytest.approx(a, rel=1e-6))


def slewing(volts: float) -> Scene:
    scene = load_scene(CASES / "slew-ua741.toml")
    return with_values(scene, {"design.unit_voltage": volts})


def beyond_limits(channels: int, **figures: str) -> Scene:
    design = {"opamp": {"base": "ua741", **figures}, "capacitance": "100pF", "lambda": 1.0}
    design |= {"gain": "1Mohm", "unit_conductance": "1uS", "unit_voltage": "5V"}
    return make_scene({"channels": channels, "span": 6.0 * channels / 7}, design=design)


FOLLOWERS = {"topology": "passive", "opamp": "ua741", "capacitance": "1nF", "lambda": 10.0}
AMPLIFIED = {"amplifier": "exponential", "exponential_slope": "0.1V", "capacitance": "100pF"}
AMPLIFIED |= {"lambda": 0.2, "gain": "100kohm", "unit_conductance": "10uS", "opamp": "ua741"}
# The scene, and what the headroom says.
SLEWING = {
    # At U0 = 1 V op-amps slew, at 8 V they reach 14 V on the way, too.
    "slewing": (slewing(1.0), "would need 1.58 V/us of 0.5 V/us;"),
    "clipping": (slewing(8.0), ""),
    "followers": (make_scene(design=FOLLOWERS | {"unit_voltage": "5V"}), ""),
    "a current": (beyond_limits(3, output_current="0.25mA"), "and largest output current"),
    "many unknowns": (beyond_limits(5), "slew rate and swing"),
    "amplifiers": (
        Scene.from_arrays([[1.0, 0.4], [0.3, 0.9]], [0.7, 0.5], design=AMPLIFIED),
        "slew rate counts",
    ),
}
LATER = ("slewing", "many unknowns")


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", [*sorted({*SLEWING} - {*LATER}), *nightly(*LATER)])
def test_both_engines_agree_on_slewing_boards(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name == "many unknowns":  # solved through its structure
        monkeypatch.setattr(descriptor, "LARGE", 100)
    scene, reason = SLEWING[name]
    verdict = verify(with_values(scene, {"analysis.error": 5e-5}).with_engine("ngspice"))
    agree = named(verdict, "engines_agree")
    assert verdict_document(verdict)["opamp_level"] == "large-signal"
    assert reason in named(verdict, "headroom").reason
    assert agree.outcome is Outcome.PASS
    assert agree.value < 1e-4
