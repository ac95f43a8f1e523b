"""Op-amps that rest beyond a limit: closed forms of their equilibria."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.spice_models.opamp import KNEE
from taction.verification.characterise.bench import OUT, Bench
from taction.verification.engines.statespace.linearised.board import LinearBoard

LIMITED = replace(OPAMPS["ua741"], large_signal=True)


@pytest.mark.parametrize("drive", [-2.0, -0.05, 0.05, 0.3])
def test_an_open_loop_rests_at_its_swing(drive: float) -> None:
    # the clamp draws what the input stage gives: tanh((x - 14)/d) + tanh((x + 14)/d) = tanh(v/V)
    drawn = math.tanh(abs(drive) / LIMITED.input_range)
    expected = 14.0 + 14.0 / KNEE * math.atanh(drawn - 1.0)
    board = LinearBoard(Bench(LIMITED, 15.0, follower=False, step=drive).circuit)
    assert board.equilibrium[OUT] == pytest.approx(math.copysign(expected, drive), rel=1e-4)


def test_a_short_circuit_takes_the_largest_current() -> None:
    # 14 V at the first pole, 75 ohm, and a drop of 15 V softplus(100 (i / 25 mA - 1))
    opamp = replace(LIMITED, limits_current=True)
    board = LinearBoard(Bench(opamp, 15.0, follower=False, step=1.0, load=1e-3).circuit)
    amps = board.equilibrium[OUT] / 1e-3
    beyond = math.log(math.expm1((14.0 - 75.0 * amps) / 15.0)) / 100.0
    assert amps == pytest.approx(25e-3 * (1.0 + beyond), rel=1e-5)
