"""Boards with varied parts: factors in closed form, draws, and the same board in two engines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import INPUT_ERROR, Parameter, draw, parameters, vary
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene

REAL = {"base": "ideal", "dc_gain": 1e5, "gbw": "5MHz", "second_pole": "15MHz"}
DESIGN = {"capacitance": "100pF", "gain": "100kohm", "stray_capacitance": "2pF", "opamp": REAL}


def scene(design: dict[str, Any] | None = None, **tables: Any) -> Scene:
    return make_scene({"channels": 2, "span": 1.2}, design=DESIGN | (design or {}), **tables)


def board(design: dict[str, Any] | None = None) -> Circuit:
    asked = scene(design)
    return synthesise(asked, make_problem(asked))


def values(circuit: Circuit) -> dict[str, float]:
    """Every value of a board by the name of its parameter."""
    found = {f"R{r.name}": r.ohms for r in circuit.resistors}
    found |= {f"C{c.name}": c.farads for c in circuit.capacitors}
    for matrix in circuit.matrices:
        for k, n, _, _, ohms in matrix.elements():
            found[f"{matrix.name}_{k + 1}_{n + 1}"] = ohms
    for cell in circuit.opamps:
        model = circuit.models[cell.model]
        found |= {f"{cell.name}.gbw": model.gbw, f"{cell.name}.dc_gain": model.dc_gain}
    return found


def random_z(count: int, seed: int = 3) -> Floats:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, count)


def test_every_part_has_its_own_factor() -> None:
    nominal, tolerances = board(), Tolerances(stray=0.5, opamp_gain=3.0)
    varied = parameters(nominal, tolerances)
    z = random_z(len(varied))
    before, after = values(nominal), values(vary(nominal, tolerances, z))
    assert {p.name for p in varied} == set(before)
    for parameter, deviation in zip(varied, z.tolist(), strict=True):
        factor = math.exp(deviation * math.log(1.0 + getattr(tolerances, parameter.kind)))
        assert after[parameter.name] == pytest.approx(before[parameter.name] * factor, rel=1e-14)


@given(st.just(0.0) | st.floats(1e-100, 1e3), st.floats(-10.0, 10.0))
def test_resistors_and_capacitors_stay_positive(tolerance: float, z: float) -> None:
    nominal = board()
    tolerances = Tolerances(
        resistor=tolerance, capacitor=tolerance, stray=tolerance, opamp_gain=0.0
    )
    after = values(vary(nominal, tolerances, np.full(len(parameters(nominal, tolerances)), z)))
    assert min(after.values()) > 0.0


def test_both_poles_move_together_and_not_with_the_gain() -> None:
    nominal = board()
    tolerances = Tolerances(resistor=0.0, capacitor=0.0, stray=0.0)
    assert {p.kind for p in parameters(nominal, tolerances)} == {"opamp_gbw", "opamp_gain"}
    count = len(parameters(nominal, tolerances))
    for model in vary(nominal, tolerances, np.full(count, 1.0)).models.values():
        assert model.gbw == pytest.approx(6.5e6)
        assert model.second_pole == pytest.approx(19.5e6)
        assert model.dc_gain == pytest.approx(1.5e5)


def test_the_temperature_moves_the_whole_board() -> None:
    nominal = board()
    cold = {"resistor": 0.0, "capacitor": 0.0, "stray": 0.0, "opamp_gbw": 0.0, "opamp_gain": 0.0}
    tolerances = Tolerances(**cold, temperature=40.0)
    assert [p.name for p in parameters(nominal, tolerances)] == ["temperature"]
    before, after = values(nominal), values(vary(nominal, tolerances, np.array([0.5])))
    drift = {"R": 1e-4, "C": 3e-5, "gbw": -3e-3}
    for name, value in after.items():
        kind = "gbw" if name.endswith(".gbw") else name[0]
        expected = math.exp(20.0 * (0.0 if name.endswith("dc_gain") else drift[kind]))
        assert value == pytest.approx(before[name] * expected, rel=1e-14)


def varied(count: int, kind: str = "resistor") -> tuple[Parameter, ...]:
    return tuple(Parameter(f"{kind}_{k}", kind, 0.01) for k in range(count))


def test_a_draw_is_its_sample_s_own_bit_for_bit() -> None:
    tolerances, parts = Tolerances(), varied(50)
    late = draw(tolerances, parts, 7, 123)
    many = [draw(tolerances, parts, 7, number) for number in (3, 123, 124)]
    assert np.array_equal(many[1], late)
    assert not np.array_equal(many[2], late)
    assert not np.array_equal(draw(tolerances, parts, 8, 123), late)


def test_the_distributions() -> None:
    normal = np.concatenate([draw(Tolerances(), varied(1000), 1, k) for k in range(40)])
    assert normal.std() == pytest.approx(1.0 / 3.0, rel=0.02)
    assert np.mean(np.abs(normal) < 1.0) == pytest.approx(0.9973, abs=1e-3)
    parts = (*varied(1000), *varied(1000, INPUT_ERROR))
    both = np.array([draw(Tolerances(distribution="uniform"), parts, 1, k) for k in range(40)])
    uniform, errors = both[:, :1000], both[:, 1000:]
    assert np.abs(uniform).max() <= 1.0
    assert uniform.std() == pytest.approx(1.0 / math.sqrt(3.0), rel=0.02)
    assert errors.std() == pytest.approx(1.0 / 3.0, rel=0.02)
    assert np.abs(errors).max() > 1.0  # normal, whatever the distribution of the parts is


def test_ngspice_and_the_state_space_agree_on_a_varied_board(ngspice: str) -> None:
    asked = scene(analysis={"engine": "ngspice", "error": 1e-4})
    problem = make_problem(asked)
    nominal = synthesise(asked, problem)
    tolerances = Tolerances(resistor=0.1, temperature=30.0)
    z = random_z(len(parameters(nominal, tolerances)), seed=5)
    varied = vary(nominal, tolerances, z)
    verdict = verify(asked, problem=problem, circuit=varied)
    assert verdict.agreement is not None
    assert verdict.agreement.difference < 1e-4 * verdict.measurements.amplitude
    # The varied board is not the nominal one: its steady state is elsewhere.
    steady = next(check for check in verdict.checks if check.name == "steady_state")
    assert steady.value is not None
    assert steady.value > 0.01
