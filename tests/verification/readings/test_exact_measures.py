"""The ways of boards' channels, and readings on their exact solutions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from taction.netlist_gen.board.circuit import Circuit, Output
from taction.netlist_gen.board.parts import OpAmpCell, VoltageSource
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.readings.exact_measures import ExactResponse
from taction.verification.readings.measurements import Measurements
from taction.verification.readings.settling import ChannelState
from tests.support.boards import bare, lags, paper_board
from tests.support.making import make_scene

OMEGA, ZETA = 2e6, 0.2


def measure_exact(circuit: Circuit | LinearBoard, target: Floats, **known: Any) -> Measurements:
    """Measure the step response of one stable linear board; `known` as in `ExactResponse`."""
    return ExactResponse(LinearBoard.of(circuit), target, **known).measured()


def second_order(zeta: float = ZETA, volts: float = 1.0, gain: float = 1e9) -> Circuit:
    """A follower of DC gain 1 - 1/gain whose two poles give ``OMEGA`` and `zeta`."""
    second = 2.0 * zeta * OMEGA / (2 * np.pi)  # p1 + p2 = 2 zeta omega
    gbw = OMEGA**2 / (2.0 * zeta * OMEGA) / (2 * np.pi)  # p2 * 2 pi gbw = omega²
    return bare(
        models={"op": OpAmp("op", gain, gbw=gbw, second_pole=second)},
        opamps=(OpAmpCell("X", "op", "in", "out", "out"),),
        voltages=(VoltageSource("V", "in", volts),),
        outputs=(Output("out", 1.0),),
    )


def response(t: float) -> float:
    decay, omega = ZETA * OMEGA, OMEGA * np.sqrt(1 - ZETA**2)
    ring = np.cos(omega * t) + decay / omega * np.sin(omega * t)
    return float(1.0 - np.exp(-decay * t) * ring)


@pytest.mark.parametrize("volts", [1.0, -3.0])
def test_a_second_order_step(volts: float) -> None:
    found = measure_exact(second_order(volts=volts), np.array([volts])).channels[0]
    damped = OMEGA * np.sqrt(1 - ZETA**2)
    half = np.pi / damped
    assert found.state is ChannelState.SETTLED
    assert found.overshoot == pytest.approx(np.exp(-ZETA * OMEGA * half), rel=1e-7)
    low = brentq(lambda t: response(t) - 0.1, 0.0, half, xtol=1e-20, rtol=1e-14)
    high = brentq(lambda t: response(t) - 0.9, 0.0, half, xtol=1e-20, rtol=1e-14)
    assert found.rise_time.value == pytest.approx(high - low, rel=1e-7)
    assert found.frequency == pytest.approx(damped / (2 * np.pi), rel=1e-7)
    assert found.growth_rate == pytest.approx(-ZETA * OMEGA, rel=1e-7)
    # The n-th extremum is exp(-zeta omega n half) off; the last one above 1 % is the seventh.
    assert np.exp(-ZETA * OMEGA * 7 * half) > 0.01 > np.exp(-ZETA * OMEGA * 8 * half)
    settled = brentq(lambda t: abs(response(t) - 1.0) - 0.01, 7 * half, 7.5 * half, xtol=1e-20)
    assert found.settling_time.value == pytest.approx(settled, rel=1e-6)
    assert found.settling_time.uncertainty < 1e-8 * settled


@pytest.mark.parametrize("periods", [0.02, 0.3, 10.0])
def test_what_a_cubic_misses_in_a_part_of_so_many_periods_is_bounded(periods: float) -> None:
    """Beside the closed form, from a quarter of a period on, where the slope is steepest."""
    zeta, period = 0.01, np.full(1, 2.0 * np.pi / OMEGA)
    trace = ExactResponse(LinearBoard(second_order(zeta, gain=1e20)), np.array([1.0])).trace
    parts = trace.divide(0.25 * period, 8.0 * periods * period, np.zeros(1, np.int64))
    pole = OMEGA * complex(-zeta, np.sqrt(1.0 - zeta**2))
    left, rise, square, cube = parts.powers()
    for x in np.linspace(0.0, 1.0, 101):
        cubic = left + x * (rise + x * (square + x * cube))
        turned = np.exp(pole * (parts.begin + x * parts.width))
        true = -(turned * complex(1.0, -zeta / np.sqrt(1.0 - zeta**2))).real
        assert np.all(np.abs(cubic - true) <= parts.room + parts.doubt)


@pytest.mark.parametrize("zeta", [1e-3, 1e-6, 1e-8])
def test_a_ringing_that_hardly_decays_settles_with_its_envelope(
    zeta: float,
) -> None:
    """Up to 1e8 periods: only those are looked at in which the envelope is near the band."""
    gain = 1e20
    found = measure_exact(second_order(zeta, gain=gain), np.array([1.0])).channels[0]
    rate, half = 0.5 * OMEGA * (2.0 * zeta + 0.5 / (zeta * gain)), np.pi / OMEGA
    met = np.log(100.0) / rate
    reading = found.settling_time
    assert met - half <= reading.value + reading.uncertainty
    assert reading.value - reading.uncertainty <= met + half
    assert reading.uncertainty < 1e-4 * met
    assert found.overshoot == pytest.approx(np.exp(-np.pi * zeta), rel=1e-6)


def test_a_peak_that_just_reaches_the_band_is_fragile() -> None:
    peak = float(np.exp(-np.pi * ZETA / np.sqrt(1 - ZETA**2) * 3))
    for factor, late in ((0.9999, True), (1.0001, False)):
        found = measure_exact(second_order(), np.array([1.0]), band=factor * peak)
        reading = found.settling_time
        assert reading.fragile
        half = float(np.pi / (OMEGA * np.sqrt(1 - ZETA**2)))
        assert (reading.value > 2.9 * half) is late
        assert (reading.alternative > 2.9 * half) is not late


def test_what_does_not_settle_says_why() -> None:
    circuit = paper_board(8e-12)
    rest = LinearBoard(circuit).equilibrium
    target = np.array([rest[node] for node in circuit.signal_nodes])
    with pytest.raises(EngineError, match="not stable"):
        measure_exact(circuit, target)

    off = measure_exact(paper_board(), target + 0.01)
    assert off.channels[0].state is ChannelState.NOT_SETTLED
    assert "disagree" in off.reason

    quiet = replace(paper_board(), currents=())
    still = measure_exact(quiet, np.zeros(7))
    assert still.settling_time is None
    assert "no channel has a step" in still.reason


def test_a_chain_of_equal_lags() -> None:
    count, tau = 5, 1e-6
    found = measure_exact(lags(count, tau), np.array([1.0])).channels[0]

    def left(x: float) -> float:
        return float(
            np.exp(-x) * sum(x**k / np.prod(np.arange(1.0, k + 1.0)) for k in range(count))
        )

    times = [brentq(lambda x, rest=rest: left(x) - rest, 1e-9, 40.0) for rest in (0.9, 0.1, 0.01)]
    assert found.rise_time.value == pytest.approx(tau * (times[1] - times[0]), rel=1e-9)
    assert found.settling_time.value == pytest.approx(tau * times[2], rel=1e-9)


def test_a_channel_that_never_leaves_the_band_settles_at_once_without_doubt():
    scene = make_scene({"channels": 3, "span": 2.0})
    circuit = synthesise(scene, make_problem(scene))
    rest = LinearBoard(circuit).equilibrium
    target = np.array([out.sign * rest[out.node] for out in circuit.outputs])
    found = measure_exact(circuit, target)
    still = [channel for channel in found.channels if abs(channel.target) < 0.01 * found.amplitude]
    assert still
    assert all(c.settling_time.value == 0.0 for c in still)
    assert all(0.0 < c.settling_time.uncertainty < 1e-20 for c in still)
