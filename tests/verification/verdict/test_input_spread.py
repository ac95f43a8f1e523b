"""The spread of a board's rest, and what is said of it, against equilibria of drawn boards."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import draw, parameters, vary, with_factors
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.input_spread import InputSpread
from taction.verification.verdict.simulation import build
from taction.verification.verdict.verify import verify
from tests.support.boards import outputs_at_rest, sampled
from tests.support.making import make_scene
from tests.support.measured import named

UA741 = {"base": "ua741", "input_errors": "typical"}
DESIGN: dict[str, Any] = {"capacitance": "1nF", "lambda": 0.1, "gain": "100kohm"}
DESIGN |= {"unit_conductance": "10uS", "stray_capacitance": "5pF"}
DESIGN |= {"opamp": UA741 | {"slew_rate": "1kV/us"}}
EXACT = Tolerances(resistor=0.0, capacitor=0.0, stray=0.0, opamp_gbw=0.0, opamp_gain=0.0)
KINDS = {
    "linear": {},
    "passive": {"topology": "passive", "lambda": 100.0},
    "exponential": {"amplifier": "exponential", "exponential_slope": "1V"},
    "large-signal": {"opamp": UA741 | {"level": "large-signal"}},
}
PROBLEM = {"kind": "matrix", "matrix": [[1.0, 0.3], [-0.2, 0.8]], "strain": [0.6, -0.4]}


BOARDS, SIGMAS = 1000, 4.0


def scene(design: dict[str, Any] | None = None, **tables: Any) -> Scene:
    analysis = {"engine": "statespace"}
    return make_scene(problem=PROBLEM, design=DESIGN | (design or {}), analysis=analysis, **tables)


def board(kind: str = "linear", **design: Any) -> Circuit:
    return synthesise(scene(KINDS[kind] | design))


def drawn_board(circuit: Circuit, deviations: dict[str, float]) -> Circuit:
    """The board with errors of the inputs of its op-amps, in standard deviations from the means."""
    varied = parameters(circuit, EXACT)
    return vary(circuit, EXACT, np.array([deviations.get(each.name, 0.0) for each in varied]) / 3.0)


@pytest.mark.parametrize("kind", KINDS)
def test_mean_and_deviation_are_those_of_drawn_boards(kind: str) -> None:
    found = InputSpread.of(LinearBoard(board(kind)))
    assert found is not None
    outputs = sampled(board(kind), 200, EXACT)
    np.testing.assert_allclose(found.sigma, outputs.std(axis=0), rtol=0.15)
    assert (np.abs(found.mean - outputs.mean(axis=0)) < 5.0 * found.sigma / np.sqrt(200)).all()
    assert found.curvature < (0.1 if kind == "exponential" else 1e-3)


def test_boards_that_differ_in_capacitors_alone_share_their_spread() -> None:
    one, other, more = (
        InputSpread.shared(LinearBoard(board(**changes)))
        for changes in ({}, {"capacitance": "2nF"}, {"gain": "200kohm"})
    )
    own = InputSpread.of(LinearBoard(board(gain="200kohm")))
    assert one is other is not None
    assert more is not None is not own
    assert np.array_equal(more.rows, own.rows)


def test_common_mode_errors_move_followers_with_their_sign() -> None:
    circuit = board("passive")
    slopes = RestSensitivity.of(LinearBoard(circuit)).input_errors()
    own = {name: s for name, s in slopes.items() if name.endswith("common_mode_rejection")}
    name = max(own, key=lambda each: float(np.abs(own[each]).max()))
    (model,) = circuit.models.values()
    sigma = dict(model.varying)["common_mode_rejection"].sigma
    up, down = (outputs_at_rest(drawn_board(circuit, {name: z})) for z in (1.0, -1.0))
    # The other errors are at their means here, and at their typical sizes in the slope.
    np.testing.assert_allclose(own[name], (up - down) / (2.0 * sigma), rtol=0.05, atol=1e-3)


def test_a_board_without_errors_has_no_spread_and_a_drawn_one_neither() -> None:
    for level in ("none", False):
        found = board(opamp={"base": "ua741", "input_errors": level})
        assert InputSpread.of(LinearBoard(found)) is None
    circuit, tolerances = board(), Tolerances()
    varied = parameters(circuit, tolerances)
    errors = [each for each in varied if each.kind == "input_error"]
    assert len(errors) == 4 * len(circuit.opamps)
    z = draw(tolerances, varied, 1, 1)
    assert InputSpread.of(LinearBoard(vary(circuit, tolerances, z))) is None


def test_the_verdict_takes_the_worse_of_one_sign_and_of_95_percent() -> None:
    verdict, found = verify(scene()), InputSpread.of(LinearBoard(board()))
    alike = named(verdict, "steady_state")
    assert found is not None
    volts, _ = found.distance(verdict.ideal.target)
    static = np.abs(verdict.steady.values - verdict.ideal.target).max()
    expected = max(volts, float(static)) / verdict.measurements.amplitude
    assert alike.value == pytest.approx(expected, rel=1e-12)
    assert alike.outcome is Outcome.FAIL
    assert volts > static
    assert "95 % of the boards" in alike.reason


ROOM = InputSpread.of(LinearBoard(board()))
HOT: dict[str, Any] = {"temperature": "0..70degC", "supply_tolerance": 0.05}


def shifted(circuit: Circuit, **figures: float) -> Floats:
    """Return how far each op-amp by itself moves the outputs, V, (op-amps, N)."""
    rows, before = [], outputs_at_rest(circuit)
    for cell in circuit.opamps:
        model = circuit.models[cell.model]
        moved = {name: getattr(model, name) + value for name, value in figures.items()}
        own = replace(model, name="own", varying=(), **moved)
        cells = tuple(replace(c, model="own") if c is cell else c for c in circuit.opamps)
        models = {**circuit.models, "own": own}
        rows.append(outputs_at_rest(replace(circuit, models=models, opamps=cells)) - before)
    return np.array(rows)


def test_drift_and_supply_rejection_are_rows_by_the_equilibria_of_changed_boards() -> None:
    """One op-amp after the other with another offset."""
    circuit = board(opamp=DESIGN["opamp"] | {"offset_drift": "10uV/K"}, **HOT)
    spread = InputSpread.of(LinearBoard(circuit))
    assert spread is not None
    each = shifted(circuit, offset_voltage=1e-3) / 1e-3
    drift = 10e-6 / 0.67 * 45.0  # a scene's figure: half of the parts keep it
    supply = 150e-6 / 3.0 * 0.05 * 15.0  # the sheet's 150 uV/V: 3 sigma
    variance = ROOM.sigma**2 + (each**2).sum(axis=0) * (drift**2 + supply**2)
    np.testing.assert_allclose(spread.sigma, np.sqrt(variance), rtol=2e-3)


def test_currents_of_field_effect_inputs_double_every_10_kelvins() -> None:
    """At 45 degrees all currents of a TL084 are four times as large."""
    design = DESIGN["opamp"] | {"base": "tl084", "offset_drift": "0V/K"}
    hot = InputSpread.of(LinearBoard(board(opamp=design, temperature="25..45degC")))
    four = {"bias_current": 3.0 * 30e-12, "offset_current": 0.0}
    circuit = board(opamp=design)
    moved = shifted(circuit, **four).sum(axis=0)
    assert hot is not None
    np.testing.assert_allclose(hot.moved, moved, rtol=1e-6)


def test_resistors_drift_each_by_itself() -> None:
    """One resistor after the other, larger by the deviation of its temperature coefficient."""
    circuit = board(opamp="ideal")
    step, squares = 1e-6, np.zeros(2)
    names = [f"R{part.name}" for part in circuit.resistors]
    for matrix in circuit.matrices:
        names += [f"{matrix.name}_{k + 1}_{n + 1}" for k, n, *_ in matrix.elements()]
    for name in names:
        changed = with_factors(circuit, {name: 1.0 + step})
        squares += ((outputs_at_rest(changed) - outputs_at_rest(circuit)) / step) ** 2
    spread = InputSpread.of(LinearBoard(circuit), 1e-4)
    assert spread is not None
    np.testing.assert_allclose(spread.sigma, 1e-4 * np.sqrt(squares), rtol=1e-3)
    assert 0.0 < spread.curvature < 1e-3


def test_the_verdict_counts_what_the_scene_asks_for() -> None:
    """The check fails where the drift is beyond its limit."""
    parts = {"opamp": DESIGN["opamp"] | {"base": "tl084", "offset_voltage": 0.0}}

    def found(**design: Any) -> Any:
        checks = {"steady_state": {"tolerance": 4e-3}, "settling_time": {"band": 0.1}}
        return verify(scene(parts | design, checks=checks))

    room, hot = found(), found(**HOT, temperature_coefficient=5e-5)
    before, after = (v.checks[0] for v in (room, hot))
    assert before.outcome is Outcome.PASS
    assert after.outcome is Outcome.FAIL
    assert after.value > 2.0 * before.value
    lacking = [text for text in found(opamp=UA741, **HOT).warnings if "not known" in text]
    assert lacking == ["op-amp ua741: bias drift not known, so left out"]


@pytest.mark.parametrize(
    ("rows", "uniform", "expected"),
    [
        (np.ones((1, 1)), 0, 1.959963985),
        (np.eye(2), 0, 2.236476502),  # (2 Phi(q) - 1)^2 = 0.95
        (np.ones((1, 2)), 0, 1.959963985),  # channels that move together
        (np.ones((1, 1)), 1, 0.95 * 3**0.5),
        (np.ones((2, 1)), 2, (2.0 - 0.2**0.5) * 3**0.5),  # triangular
        (np.ones((400, 1)), 400, 1.959963985 * 20.0),
    ],
)
def test_the_distance_is_that_of_the_quantile(rows: Floats, uniform: int, expected: float) -> None:
    count = rows.shape[1]
    spread = InputSpread(np.zeros(count), rows, uniform)
    distance, error = spread.distance(np.zeros(count))
    assert abs(distance - expected) < min(error, 0.02 * expected)
    assert 0.95 < spread.within(np.zeros(count), expected) < 0.97


@pytest.mark.parametrize("mean", [0.3, 0.0])
def test_with_changes_around_the_farther_of_both_places_counts(mean: float) -> None:
    """At 0.3 V in the heat or in the cold, at 0 without; 95 % are within 0.3 V and 1.645 sigma."""
    spread = InputSpread(np.array([mean]), np.array([[0.01]]), 0, moved=np.array([0.3]))
    distance, error = spread.distance(np.zeros(1))
    assert abs(distance - 0.3 - 1.6448536 * 0.01) < min(error, 1e-3)
    assert 0.5 < spread.within(np.zeros(1), 0.3) < 0.52


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_gains_of_op_amps_spread_the_outputs_at_rest(distribution: str) -> None:
    tolerances = {"resistor": 0.0, "opamp_gain": 0.1, "distribution": distribution}
    asked = scene({"opamp": {"base": "ideal", "dc_gain": 2e3}}, tolerances=tolerances)
    spread = build(asked).built_spread(asked.tolerances)
    assert spread is not None
    rests = sampled(synthesise(asked), BOARDS, asked.tolerances)
    assert spread.sigma == pytest.approx(rests.std(axis=0), rel=SIGMAS / math.sqrt(2.0 * BOARDS))
