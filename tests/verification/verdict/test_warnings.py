"""What a designer should know although no check failed, and numbers that contradict each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.system.reading_definitions import READINGS
from taction.verification.readings.readings import Reading
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.verdict.companion import StepError
from taction.verification.verdict.warnings import find_contradiction, find_warnings
from tests.support.making import make_scene, matrix_problem
from tests.support.measured import EXACT, UNSTABLE, channel, evidence
from tests.support.poles import rounded_poles


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
    edge = rounded_poles(np.array([-50 + 1e5j, -50 - 1e5j]))
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


PROBLEM = matrix_problem([[1.0, -0.3], [0.2, 0.8]], [1.0, 0.5])


def made(**design: Any) -> tuple[Circuit, IdealAnswer]:
    scene = make_scene(design=design)
    return synthesise(scene, PROBLEM), ideal_answer(ideal_network(PROBLEM, scene), scene)


@pytest.mark.parametrize("given", [{"lambda": 0.3}, {"resistance": "2Mohm"}])
@pytest.mark.parametrize("amplifier", ["linear", "exponential", "tanh"])
def test_a_board_and_its_reference_agree(amplifier: str, given: dict[str, Any]) -> None:
    volts = {"unit_voltage": "0.3V"}
    if amplifier != "linear":
        volts["exponential_slope"] = "70mV"
    circuit, ideal = made(amplifier=amplifier, **volts, **given)
    assert find_contradiction(circuit, ideal, ideal.start) == ""


@pytest.mark.parametrize(
    ("number", "text"),
    [
        ("lambda", "the board states lambda = 0.6, the reference uses 0.3"),
        ("U0", "the board states unit_voltage = 2.0, the reference uses 1.0"),
        ("Ve", "the board states exponential_slope = 0.14, the reference uses 0.07"),
    ],
)
def test_another_number_is_a_contradiction(number: str, text: str) -> None:
    slope = {"amplifier": "exponential", "exponential_slope": "70mV"} if number == "Ve" else {}
    circuit, ideal = made(**{"lambda": 0.3}, **slope)
    doubled = replace(circuit.facts[number], value=2.0 * circuit.value(number))
    changed = replace(circuit, facts={**circuit.facts, number: doubled})
    assert text in find_contradiction(changed, ideal, ideal.start)


@pytest.mark.parametrize("changes", [{"error": 1.0}, {"problem": "the gap is too wide"}])
def test_without_a_step_to_judge_no_start_is_compared(changes: dict[str, Any]) -> None:
    circuit, ideal = made(**{"lambda": 0.3})
    assert find_contradiction(circuit, ideal, ideal.start + 1.0).startswith("channel 1 starts at")
    assert find_contradiction(circuit, replace(ideal, **changes), ideal.start + 1.0) == ""


@pytest.mark.parametrize(("away", "found"), [(0.09, False), (0.11, True)])
def test_a_record_starts_where_the_reference_starts(away: float, found: bool) -> None:
    circuit, ideal = made(amplifier="exponential", **{"lambda": 0.3})
    amplitude = float(np.abs(ideal.target - ideal.start).max())
    start = ideal.start + np.array([0.0, away * amplitude])
    text = find_contradiction(circuit, ideal, start)
    assert text.startswith("channel 2 starts at") is found
    assert bool(text) is found
