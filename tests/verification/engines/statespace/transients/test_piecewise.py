"""Boards of piecewise linear amplifiers: switches against an independent transient, and events."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.board.parts import (
    Capacitor,
    CurrentSource,
    OpAmpCell,
    Resistor,
    SignalAmplifier,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import OpAmp
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import piecewise, simulate
from taction.verification.engines.statespace.transients.piecewise import PiecewiseCurve
from tests.support.boards import bare
from tests.support.kinked import kinked_transient
from tests.support.piecewise_boards import compare_board

SCENES = Path(__file__).parents[5] / "scenes"
RC = 1e-5  # s
OPAMP = {"base": "ideal", "dc_gain": 1e5, "gbw": 718e3, "second_pole": 2.154e6}


def one_channel(strain: float, capacitance: float, amplifier: str = "saturation") -> LinearBoard:
    """A board of one channel, which rings."""
    scene = Scene.from_arrays(
        np.eye(1), np.array([strain]), amplifier=amplifier, exponential_slope=0.1, opamp=OPAMP,
        capacitance=capacitance, resistance=2e6, gain=1e6, unit_conductance=1e-6,
        stray_capacitance=2e-12,
    )  # fmt: skip
    return LinearBoard(synthesise(scene))


def curve_of(board: LinearBoard, stop: float) -> PiecewiseCurve:
    nodes = board.reported(None)
    return piecewise.solve_pieces(board, Transient(stop, stop), nodes, stop)


@pytest.mark.parametrize("seed", [0, 3, 30, 41])
def test_random_boards_are_within_their_bound_of_another_transient(seed: int) -> None:
    found = compare_board(seed, points=251)
    assert not found.outside, found


@pytest.mark.parametrize(("name", "stop"), [("lasso", 4e-3), ("non-negative", 1e-4), ("box", 2e-3)])
def test_the_shipped_scenes_are_within_their_bound(name: str, stop: float) -> None:
    board = LinearBoard(synthesise(load_scene(SCENES / f"{name}.toml")))
    times = np.linspace(0.0, stop, 51)
    record = simulate.simulate(board, Transient(stop, stop / 50), times=times)
    assert record.method == piecewise.METHOD
    curve = record.curve
    assert isinstance(curve, PiecewiseCurve)
    assert len(curve.pieces) > 1
    truth, doubt, _ = kinked_transient(
        board, Transient(stop, stop / 50), times, board.reported(None)
    )
    assert np.all(np.abs(record.values - truth) <= curve.bounds(times) + doubt + 1e-9)


def test_channels_that_mirror_each_other_switch_together() -> None:
    board = LinearBoard(synthesise(load_scene(SCENES / "lasso.toml")))
    curve = curve_of(board, 1e-3)
    segments = np.array([piece.active.segments for piece in curve.pieces])
    apart = (segments != segments[:, ::-1]).any(axis=1)
    assert curve.lengths[apart].sum() <= 1e-9 * curve.stop  # rounding of an input over its slope
    assert curve.pieces[-1].active.segments == (1, 1, 2, 2, 2, 1, 1)


def test_an_input_that_only_touches_a_break_changes_nothing_at_once() -> None:
    """Just below and just above a grazing contact the records are alike, with and without it."""
    stop, low, high = 1e-4, 0.6, 0.99
    for _ in range(60):
        middle = 0.5 * (low + high)
        few = len(curve_of(one_channel(middle, 20e-12), stop).pieces) == 1
        low, high = (middle, high) if few else (low, middle)
    below, above = (curve_of(one_channel(strain, 20e-12), stop) for strain in (low, high))
    assert len(below.pieces) == 1
    times = np.linspace(0.0, stop, 2001)
    assert below.at(times) == pytest.approx(above.at(times), abs=1e-9)
    farther = curve_of(one_channel(1.01 * high, 20e-12), stop)
    assert len(farther.pieces) > 1
    assert 0.0 < farther.lengths[1] < stop  # behind the break, and back


def test_no_input_is_behind_a_break_between_two_switches() -> None:
    board = LinearBoard(synthesise(load_scene(SCENES / "non-negative.toml")))
    curve = curve_of(board, 2e-3)
    for piece, length in zip(curve.pieces, curve.lengths.tolist(), strict=True):
        y = piece.at(np.linspace(0.0, length, 500))[:, : piece.count]
        room = 4.0 * piece.slack
        assert np.all((y >= piece.active.low - room) & (y <= piece.active.high + room))


def test_the_states_pass_a_switch_unchanged() -> None:
    board = LinearBoard(synthesise(load_scene(SCENES / "box.toml")))
    curve = curve_of(board, 2e-3)
    for before, after in pairwise(curve.pieces):
        x, _ = before.state_at(after.begin - before.begin)
        assert after.active.space.states == before.active.space.states
        assert after.x == pytest.approx(x, abs=1e-9)


def test_an_unstable_board_that_saturates_has_a_limit_cycle() -> None:
    board = one_channel(0.3, 3e-12)
    assert board.state_space.modes.poles[0].real > 0.0
    curve = piecewise.solve_pieces(
        board, Transient(1e-3, 1e-6), board.reported(None), 1e-3, bounded=False
    )
    cycle = curve.limit_cycle()
    assert cycle is not None
    assert cycle.multiplier < 1.0
    # The period again, by the crossings of the mean output in another transient.
    times = np.linspace(0.0, 3.0 * cycle.begin + 6.0 * cycle.period, 601)
    truth, _, _ = kinked_transient(board, Transient(times[-1], 1e-6), times, board.reported(None))
    late = truth[300:, 0] - 0.5 * (truth[300:, 0].max() + truth[300:, 0].min())
    rising = np.flatnonzero((late[:-1] < 0.0) & (late[1:] >= 0.0))
    period = (rising[-1] - rising[0]) * times[1] / (len(rising) - 1)
    assert period == pytest.approx(cycle.period, rel=1e-2)
    record = piecewise.simulate(board, Transient(2e-5, 1e-7))
    assert any("stable limit cycle" in flag for flag in record.flags)
    assert curve_of(one_channel(0.3, 500e-12), 1e-3).limit_cycle() is None


def own_driver(loop: float, kind: str, amps: float, farads: float = 0.0) -> LinearBoard:
    """``v = (1 - s) x + s y``, y = 10 (g(v) of 0.1 V): a loop gain of ``loop = 10 s`` at once.

    x is a capacitor that `amps` charge through a resistor, both of 1 / `RC`; `farads` delay v.
    """
    ohms, share = 1e4, 0.1 * loop
    delays = (Capacitor("Cv", "v", "0", farads),) if farads else ()
    circuit = bare(
        models={"op": OpAmp("op", 1e9)},
        amplifier=kind,
        opamps=(OpAmpCell("Xb", "op", "x", "b", "b"), OpAmpCell("Xi", "op", "0", "j", "y")),
        amplifiers=(SignalAmplifier("B", kind, "v", "m", 1.0, 0.1),),
        resistors=(
            Resistor("R", "x", "0", ohms), Resistor("R1", "m", "j", ohms),
            Resistor("R2", "j", "y", ohms), Resistor("Ra", "b", "v", ohms / (1.0 - share)),
            Resistor("Rb", "y", "v", ohms / share),
        ),
        capacitors=(Capacitor("C", "x", "0", RC / ohms), *delays),
        currents=(CurrentSource("I", "x", amps),),
        outputs=(Output("y", 1.0),),
    )  # fmt: skip
    return LinearBoard(circuit)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_board_that_would_jump_at_a_break_is_refused_in_words(sign: float) -> None:
    """Up to a loop gain of 1 there is one voltage for each state; above 1 a delay decides."""
    stop, amps = 30.0 * RC, sign * 1e-5
    x = sign * 0.1 * -np.expm1(-np.linspace(0.0, 30.0, 61))
    for loop in (0.3, 0.99):
        share = 0.1 * loop
        record = piecewise.simulate(
            own_driver(loop, "saturation", amps), Transient(stop, RC),
            times=np.linspace(0.0, stop, 61),
        )  # fmt: skip
        inner = 10.0 * (1.0 - share) * x / (1.0 - loop)
        assert record.values[:, 0] == pytest.approx(np.clip(inner, -1.0, 1.0), abs=1e-6)
    jumping = own_driver(1.1, "saturation", 10.0 * amps)
    with pytest.raises(EngineError, match=r"amplifiers m .* by a gain above 1: .* and jumps"):
        piecewise.simulate(jumping, Transient(stop, RC))
    delayed = own_driver(1.1, "saturation", 10.0 * amps, farads=1e-12)
    assert piecewise.simulate(delayed, Transient(stop, RC)).values[-1] == pytest.approx([sign])


def test_an_amplifier_may_start_on_its_break_and_drive_itself() -> None:
    """It was refused: the voltages beside which a jump counts were still zero."""
    board = own_driver(0.5, "rectifier", -1e-5)
    curve = curve_of(board, 10.0 * RC)
    assert [piece.active.segments for piece in curve.pieces] == [(1,), (0,)]
    assert not curve.at(np.linspace(0.0, 10.0 * RC, 50)).any()
