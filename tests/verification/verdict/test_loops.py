"""Closed-loop boards, verified: three witnesses agree, and the bounds hold for exact values."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import taction
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.verification.evidence.stress.run_cases import compare
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.measured import named
from tests.support.true_values import true_values

T = np.array(
    [[1.0, 0.3, -0.2, 0.0], [0.3, 1.2, 0.3, 0.1], [-0.1, 0.3, 1.1, 0.3], [0.0, 0.1, 0.3, 0.9]]
)
EPS = np.array([0.5, -0.3, 0.8, 0.2])
MORE, MORE_EPS = np.array([[0.5, 0.2, 0.1, 0.4], [0.1, -0.7, 0.2, 0.2]]), [0.1, -0.4]
TOPOLOGIES = ("inv", "pinv", "ridge")
WAYS = ("inverters", "differential", "offset")
BAND = 0.01  # of the settling time
INVERTER = 1e4  # ohm


def scene(topology: str, engine: str = "statespace", **design: Any) -> Scene:
    tall = topology != "inv"
    matrix = np.vstack([T, MORE]) if tall else T
    strain = np.append(EPS, MORE_EPS) if tall else EPS
    table: dict[str, Any] = {
        "topology": topology, "unit_conductance": "50uS", "stray_capacitance": "2pF",
        "opamp": "opa2134", "negative_entries": "differential",
        **({"feedback_conductance": "400uS"} if tall else {}),
        **({"lambda": 0.05} if topology == "ridge" else {}), **design,
    }  # fmt: skip
    problem = {"kind": "matrix", "matrix": matrix.tolist(), "strain": strain.tolist()}
    checks = {"steady_state": {"tolerance": 5e-3}, "settling_time": {"band": 0.01, "max": "20us"}}
    return make_scene(problem, design=table, checks=checks, analysis={"engine": engine})


@pytest.mark.parametrize("topology", ["inv", "pinv", "ridge"])
@pytest.mark.parametrize("way", ["inverters", "differential"])
def test_three_witnesses_agree(ngspice: str, topology: str, way: str) -> None:
    found = taction.verify(scene(topology, "ngspice", negative_entries=way))
    assert found.outcome is named(found, "engines_agree").outcome is Outcome.PASS, str(found)
    exact = taction.verify(scene(topology, negative_entries=way))
    both = [v.measurements.settling_time for v in (found, exact)]
    apart = abs(both[0].value - both[1].value)
    assert apart <= both[0].uncertainty + both[1].uncertainty


def board_scene(seed: int) -> Scene:
    """Return the scene of a seed."""
    rng = np.random.default_rng([27, seed])
    topology, way = TOPOLOGIES[seed % 3], WAYS[seed // 3 % 3]
    N = int(rng.integers(2, 13))
    M = N if topology == "inv" else N + int(rng.integers(0, 4))
    T = 0.3 * rng.standard_normal((M, N)) * (rng.random((M, N)) < 0.8)
    T[:, 0] += 0.2  # no row without an entry
    T[:N] += np.diag(rng.uniform(0.5, 1.5, N)) * (1.0 + 0.3 * math.sqrt(N) * (topology == "inv"))
    gbw = float(10.0 ** rng.uniform(6.0, 8.0))
    opamp: dict[str, Any] = {
        "base": "ideal", "dc_gain": float(10.0 ** rng.uniform(4.0, 7.0)), "gbw": gbw,
        "output_resistance": 0.0,
    }  # fmt: skip
    if rng.random() < 0.5:
        opamp["second_pole"] = gbw * float(10.0 ** rng.uniform(0.0, 1.5))
    if rng.random() < 0.5:
        opamp["input_capacitance"] = float(10.0 ** rng.uniform(-13.0, -11.0))
    design = {
        "topology": topology, "negative_entries": way, "opamp": opamp,
        "unit_conductance": float(10.0 ** rng.uniform(-5.0, -3.5)), "stray_capacitance": 0,
        "strain_input": ("current", "voltage")[int(rng.integers(2))],
        "inverter_resistance": INVERTER,
        **({"lambda": float(10.0 ** rng.uniform(-2.0, 0.0))} if topology == "ridge" else {}),
    }  # fmt: skip
    if topology != "inv":
        factor = float(10.0 ** rng.uniform(-0.5, 1.0))
        design["feedback_conductance"] = design["unit_conductance"] * factor
    problem = {"kind": "matrix", "matrix": T.tolist(), "strain": rng.standard_normal(M).tolist()}
    checks = {"settling_time": {"band": BAND}}
    return make_scene(problem, design=design, checks=checks, analysis={"engine": "statespace"})


@pytest.mark.parametrize("seed", [*range(9), 15, 34])
def test_random_boards_are_inside_their_uncertainty(seed: int) -> None:
    """Every reading of every channel beside the deck's text; 34 has two poles and capacitance."""
    scene = board_scene(seed)
    verdict = verify(scene)
    numbers = compare(verdict, true_values(scene))
    assert [each.name for each in numbers if each.outside] == []
    assert len(numbers) > (4 if verdict.poles.stable else 0)


def test_an_op_amp_a_millionth_faster_is_outside() -> None:
    one = board_scene(3)
    faster = with_values(one, {"design.opamp.gbw": one.design.opamp.gbw * (1.0 + 1e-6)})
    assert sum(each.outside for each in compare(verify(one), true_values(faster))) > 4


def test_a_faulty_board_does_not_pass() -> None:
    """One resistor of array 2 is 2 % off: the witnesses do not hide it."""
    one = scene("pinv")
    circuit = taction.synthesise(one)
    feedback = next(each for each in circuit.matrices if each.name == "Rb")
    ohms = feedback.ohms.copy()
    ohms[1, 1] *= 1.02
    wrong = tuple(
        replace(each, ohms=ohms) if each is feedback else each for each in circuit.matrices
    )
    found = verify(one, circuit=replace(circuit, matrices=wrong))
    assert named(found, "steady_state").outcome is Outcome.FAIL


def test_the_margin_of_inv_is_where_the_slowest_inputs_let_a_mode_grow() -> None:
    """``(s + wp)(1 + t2 s)(1 + tc s) + wt mu = 0`` by Hurwitz; tc = C/(row sum G0), all alike."""
    G0, C, t2, gbw, A0 = 1e-4, 1e-12, 30e-9, 1e7, 1e5
    wt, wp = math.tau * gbw, math.tau * gbw / A0
    ring = 0.6 * np.eye(5) + 0.2 * (np.roll(np.eye(5), 1, 0) + np.roll(np.eye(5), -1, 0))
    opamp = {
        "base": "ideal", "dc_gain": A0, "gbw": gbw, "second_pole": 1.0 / (math.tau * t2),
        "output_resistance": 0.0, "input_capacitance": C,
    }  # fmt: skip

    def excess(tc: float) -> float:
        a = t2 + tc + wp * t2 * tc
        return float(a * (1.0 + wp * (t2 + tc)) - t2 * tc * (wp + wt))  # mu = 1, the largest

    edge = float(brentq(excess, 1e-9, 1e-5, xtol=1e-21, rtol=1e-13)) / (C / G0)
    one = scene("inv", unit_conductance=G0, stray_capacitance=0, opamp=opamp)
    problem = {"kind": "matrix", "matrix": ring.tolist(), "strain": [1.0, 0.0, 0.0, 0.5, 0.0]}
    for asked, outcome in ((0.99 * edge, Outcome.PASS), (1.01 * edge, Outcome.FAIL)):
        checks = {"steady_state": {"tolerance": 5e-3}, "stability": {"margin": asked}}
        found = taction.verify(with_values(one, {"problem": problem, "checks": checks}))
        check = named(found, "stability")
        assert abs(check.value - edge) <= check.uncertainty <= 2e-6 * edge
        assert check.outcome is outcome
    assert f"G0 can shrink by the factor {edge:.4g}" in check.reason


def test_the_onset_over_gf_is_confirmed_on_both_sides(ngspice: str) -> None:
    """Transients of ngspice grow below the least gf and decay above it, at the poles' rates."""
    found = taction.onset(scene("pinv"), over={"feedback_conductance": (1e-4, 1e-3, 13)})
    last = max(found.findings, key=lambda each: each.crossing.value)
    assert last.confirmed is True
    sides = last.below, last.above
    assert [side.rate > 0.0 for side in sides] == [True, False]
    assert [side.agrees for side in sides] == [True, True]
