"""What a designer should know although no check failed."""

from __future__ import annotations

import numpy as np
import pytest

from taction.system.reading_definitions import READINGS
from taction.verification.readings.readings import Reading
from taction.verification.stability.poles import summarise
from taction.verification.verdict.bounded_measures import StepError
from taction.verification.verdict.warnings import find_warnings
from tests.support.measured import EXACT, UNSTABLE, channel, evidence


def errors(steady_state: float = 0.0, **readings: float) -> StepError:
    return StepError(steady_state, dict.fromkeys(READINGS, 0.0) | readings)


def test_a_board_in_order_has_none() -> None:
    assert find_warnings(evidence(error=EXACT)) == ()


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (errors(2e-4), "steady_state: the tolerance 0.001 is not well"),
        (errors(overshoot=0.02), "overshoot: the limit 0.15 is not well above"),
    ],
)
def test_a_tolerance_close_to_the_simulations_error(error: StepError, says: str) -> None:
    (found,) = find_warnings(evidence(checks={"overshoot": {"max": 0.15}}, error=error))
    assert says in found
    assert "points_per_period" in found


def test_a_board_at_the_edge_of_oscillation() -> None:
    edge = summarise(np.array([-50 + 1e5j, -50 - 1e5j]), complete=True)
    (found,) = find_warnings(evidence(poles=edge))
    assert "damping ratio 0.0005" in found


def test_a_fragile_reading_comes_with_both_values() -> None:
    fragile = channel(3, rise_time=Reading(10.4e-6, 0.0, True, 4.3e-6))
    (found,) = find_warnings(evidence(fragile))
    assert found == (
        "channel 4: rise time 10.4 us is fragile: 4.3 us with the level shifted by 0.5% of the step"
    )


def test_an_engines_own_doubts_come_first_and_always() -> None:
    assert find_warnings(evidence(), ("singular matrix",)) == ("singular matrix",)
    worst = StepError(1.0, dict.fromkeys(READINGS, 1.0))
    assert find_warnings(evidence(error=worst, poles=UNSTABLE), ("note",)) == ("note",)
