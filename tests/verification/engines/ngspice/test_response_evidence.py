"""Small-signal analyses: a closed form, and results that are not those asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.analysis import Band, OperatingPoint, SmallSignal
from taction.system.errors import BadEvidence
from taction.verification.engines.ngspice.process import find_simulator, start
from tests.support.small_decks import SmallDeck

BAND = Band(1e3, 40, 10)


def low_pass(card: str = ".ac dec 10 1000.0 10000000.01") -> SmallDeck:
    """1 kohm and 1 nF: a corner at 159 kHz."""
    cards = ["* a low pass", "V1 in 0 0.0 ac 1.0", "R1 in out 1000.0", "C1 out 0 1e-9"]
    text = "\n".join([*cards, ".save v(out) v(in)", card, ".end", ""])
    return SmallDeck(text, ("out", "in"), SmallSignal(BAND))


def test_a_low_pass_is_that_of_the_closed_form(ngspice: str) -> None:
    with start(low_pass(), find_simulator(), timeout=60.0) as run:
        frequency, volts = run.response()
    assert frequency == pytest.approx(1e3 * 10.0 ** (np.arange(41) / 10), rel=1e-9)
    assert volts[:, 0] == pytest.approx(1.0 / (1.0 + 2j * np.pi * frequency * 1e-6), rel=1e-9)
    assert volts[:, 1] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("deck", "reason"),
    [
        (low_pass(".ac dec 10 1000.0 1000000.01"), "31 frequencies; 41 from 1000 to 1e\\+07 Hz"),
        (low_pass(".ac dec 10 2000.0 20000000.01"), "41 frequencies; 41 from 1000 to 1e\\+07 Hz"),
        (low_pass(".op"), "only 'complex' is read"),
        (replace(low_pass(), saved=("out",)), "with frequency and v\\(out\\) was asked for"),
        (replace(low_pass(), analysis=OperatingPoint()), "OperatingPoint, not SmallSignal"),
    ],
)
def test_another_result_is_no_evidence(ngspice: str, deck: SmallDeck, reason: str) -> None:
    with (
        start(deck, find_simulator(), timeout=60.0) as run,
        pytest.raises(BadEvidence, match=reason),
    ):
        run.response()
