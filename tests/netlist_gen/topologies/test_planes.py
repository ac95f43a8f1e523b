"""The board: its parts, its signs, what is left out, and its equilibrium.

The equilibrium comes from the state-space equations, which see only the circuit; the solution
from the reference solver, which sees only T, eps and lambda. `INPUT_T` has strains as voltages
through resistors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import ArrayLike, NDArray

import taction
from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import parameters
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.solve import solve
from tests.support.boards import outputs_at_rest
from tests.support.making import NEAR_IDEAL, make_scene, matrix_problem

T = [[1.0, -0.5, 0.0], [0.25, 2.0, 0.0]]  # column 3 is empty, row 2 has no negative entry
DESIGN: dict[str, Any] = {
    "gain": "100kohm",
    "unit_conductance": "10uS",
    "lambda": 0.1,
    "opamp": NEAR_IDEAL,
    "stray_capacitance": 0,
}
WITH_ZEROS = [[1.0, 0.0, -1.0], [2.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
PRUNED = [[2.0, -0.01, 0.0], [0.5, 1.0, 0.019], [0.002, 0.0, -0.015]]


def design(**changes: Any) -> Scene:
    return make_scene(design={**DESIGN, **changes})


def build(scene: Scene, T: ArrayLike, eps: ArrayLike) -> Circuit:
    return synthesise(scene, matrix_problem(T, eps))


def tikhonov(T: ArrayLike, eps: ArrayLike, lam: float) -> NDArray[np.float64]:
    T = np.array(T, float)
    stacked = np.vstack([T, np.sqrt(lam) * np.eye(T.shape[1])])
    load = np.append(np.array(eps, float), np.zeros(T.shape[1]))
    return np.asarray(np.linalg.lstsq(stacked, load, rcond=None)[0])


def names(parts: Sequence[Any], prefix: str) -> set[str]:
    return {part.name for part in parts if part.name.startswith(prefix)}


def test_only_what_the_signs_need_is_placed() -> None:
    circuit = build(design(), T, [1.0, 0.0])
    assert {cell.name for cell in circuit.opamps} == {
        *("v_1", "v_2", "v_3"),  # signal nodes
        *("a_1", "a_2"),  # inverters of u: columns with a positive entry
        *("c_1", "c_2"),  # constraint nodes
        "z_1",  # inverter of w: rows with a negative entry
    }
    assert [source.name for source in circuit.currents] == ["eps_1"]  # the other strain is zero
    assert circuit.currents[0].amps == pytest.approx(1e-5)
    assert circuit.voltages == ()
    assert circuit.amplifiers == ()
    forward, backward = circuit.matrices
    assert [(k, n, a, b) for k, n, a, b, _ in forward.elements()] == [
        (0, 0, "a_1", "c_1"),
        (0, 1, "v_2", "c_1"),
        (1, 0, "a_1", "c_2"),
        (1, 1, "a_2", "c_2"),
    ]
    assert [(k, n, a, b) for k, n, a, b, _ in backward.elements()] == [
        (0, 0, "w_1", "x_1"),
        (0, 1, "z_1", "x_2"),
        (1, 0, "w_2", "x_1"),
        (1, 1, "w_2", "x_2"),
    ]
    assert forward.ohms[0].tolist() == pytest.approx([1e5, 2e5, np.inf])
    assert circuit.realised == pytest.approx(np.array(T), rel=1e-15)
    assert [part.name for part in circuit.capacitors] == ["c_1", "c_2", "c_3"]


def test_an_exponential_board_has_its_stages_and_its_bias() -> None:
    circuit = build(design(amplifier="exponential", exponential_slope="0.2V"), T, [1.0, 1.0])
    assert [stage.name for stage in circuit.amplifiers] == ["a_1", "a_2", "a_3"]
    assert names(circuit.opamps, "u_") == {"u_2"}  # +u is needed where an entry is negative
    assert [(s.node, s.volts) for s in circuit.voltages] == [("bias", 0.2)]
    assert names(circuit.resistors, "bias_") == {"bias_1", "bias_2", "bias_3"}
    assert [(o.node, o.sign) for o in circuit.outputs] == [
        ("a_1", -1.0),
        ("a_2", -1.0),
        ("a_3", -1.0),
    ]
    unbiased = build(design(amplifier="exponential", bias=False), T, [1.0, 1.0])
    assert (unbiased.voltages, names(unbiased.resistors, "bias_")) == ((), set())


def test_stray_capacitance_stands_at_every_summing_node() -> None:
    circuit = build(design(stray_capacitance="2pF"), T, [1.0, 1.0])
    summing = {cell.inverting for cell in circuit.opamps}
    stray = {part.a: part.farads for part in circuit.capacitors if part.name.startswith("stray_")}
    assert stray == dict.fromkeys(summing, 2e-12)


def test_lambda_and_resistance_say_the_same() -> None:
    by_lam = build(design(**{"lambda": 0.1}), T, [1.0, 1.0])
    assert by_lam.value("R") == pytest.approx(1 / (0.1 * 1e5 * 1e-10), rel=1e-15)
    by_R = build(design(**{"lambda": None, "resistance": by_lam.value("R")}), T, [1.0, 1.0])
    assert by_R.value("lambda") == pytest.approx(0.1, rel=1e-15)
    exponential = build(
        design(amplifier="exponential", exponential_slope=0.2, unit_voltage=4.0), T, [1.0, 1.0]
    )
    assert exponential.value("R") == pytest.approx(2 * 0.2 / (0.1 * 1e5 * 1e-10 * 4.0))


def test_the_matrix_and_all_other_resistors_come_from_the_series() -> None:
    circuit = build(design(resistor_series="E24"), [[0.77, -1.4]], [1.0])
    assert circuit.forward.ohms.tolist() == [[130e3, 75e3]]  # of 129.9k and 71.43k
    assert {part.ohms for part in circuit.resistors} == {1e6, 1e5, 1e4}
    realised = circuit.realised
    assert realised[0, 0] == pytest.approx(1 / 1.3)
    assert realised[0, 1] < 0


@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_a_linear_board_rests_at_the_tikhonov_solution(topology: str) -> None:
    A, eps = [[0.3, -0.2, 0.0], [0.1, 0.4, 0.25], [0.0, 0.2, -0.3]], [1.0, -0.5, 0.25]
    scene = design(topology=topology, gain="1Mohm", unit_voltage=2.0)
    found = outputs_at_rest(build(scene, A, eps)) / 2.0
    assert found == pytest.approx(tikhonov(A, eps, 0.1), rel=1e-7)


def test_a_passive_node_is_raised_by_what_the_matrix_loads_it_with() -> None:
    scene = design(topology="passive", gain="1Mohm")
    circuit = build(scene, [[0.3, -0.2], [0.1, 0.4]], [1.0, 1.0])
    R = circuit.value("R")
    ohms = {part.name: part.ohms for part in circuit.resistors}
    assert 1 / ohms["r_1"] == pytest.approx(1 / R - 0.4 * 1e-5, rel=1e-12)
    assert 1 / ohms["r_2"] == pytest.approx(1 / R - 0.6 * 1e-5, rel=1e-12)


def test_a_passive_board_that_cannot_be_is_refused_with_its_numbers() -> None:
    with pytest.raises(InputError, match="loads channel 1") as caught:
        build(design(topology="passive"), T, [1.0, 1.0])
    message = str(caught.value)
    assert "1.25e-05 S" in message  # (|T_11| + |T_21|) G0
    assert "below 80000 ohm" in message
    assert "1e+06 ohm" in message  # what lambda asks for
    with pytest.raises(InputError, match="set bias = false"):
        build(design(topology="passive", amplifier="exponential", gain=1e8), [[1e-3]], [1.0])


@pytest.mark.parametrize(
    ("topology", "bias"), [("integrator", True), ("integrator", False), ("passive", False)]
)
def test_an_exponential_board_rests_at_maximum_entropy(topology: str, bias: bool) -> None:
    A, eps = [[0.3, -0.2, 0.1], [0.1, 0.4, 0.25]], [1.0, 0.5]
    scene = design(
        amplifier="exponential", topology=topology, bias=bias, gain="1Mohm",
        exponential_slope=0.5, unit_voltage=2.0,
    )  # fmt: skip
    u = outputs_at_rest(build(scene, A, eps)) / 2.0
    # Stationary: 2 T^T (T u - eps) + lam (log u + bias) = 0; no solver takes part.
    gradient = 2 * np.array(A).T @ (np.array(A) @ u - eps) + 0.1 * (np.log(u) + bias)
    assert gradient == pytest.approx([0.0, 0.0, 0.0], abs=1e-8)


@settings(max_examples=40)
@given(
    arrays(
        float, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.floats(-2, 2, width=16)
    ),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["linear", "exponential"]),
    st.sampled_from([1e-3, 1.0, 30.0]),
    st.sampled_from([1e-9, 1e-5, 1e-3]),
)
def test_any_near_ideal_board_rests_where_the_reference_says(
    A: NDArray[np.float64], seed: int, amplifier: str, lam: float, G0: float
) -> None:
    A = np.where(np.abs(A) < 1e-2, 0.0, A)
    assume(A.any())
    eps = np.random.default_rng(seed).standard_normal(A.shape[0])
    changes = {"lambda": lam, "unit_conductance": G0, "gain": 1 / G0, "inverter_resistance": 1 / G0}
    scene = design(amplifier=amplifier, **changes)
    problem = matrix_problem(A, eps)
    solution = solve(ideal_network(problem, scene).problem)
    found = outputs_at_rest(synthesise(scene, problem))
    assert np.max(np.abs(found - solution.u)) <= 1e-7 * max(1.0, np.max(np.abs(solution.u)))


def omissions(**design: Any) -> dict[str, str]:
    circuit = synthesise(make_scene(design=design), matrix_problem(WITH_ZEROS, [1.0, 0.0, 2.0]))
    return {item.what: item.why for item in circuit.omissions}


def test_a_linear_board_of_ideal_opamps() -> None:
    found = omissions(opamp="ideal", stray_capacitance=0)
    assert found["10 matrix resistors"] == "5 entries of T are zero"
    assert found["1 constraint nodes"].startswith("their rows of T are all zeros")
    assert found["1 strain currents"] == "their strain is zero"
    assert found["1 inverters of u"] == "their columns have no positive entry"
    assert found["1 inverters of w"] == "their rows have no negative entry"
    assert found["stray capacitors"] == "design.stray_capacitance is 0"
    assert found["op-amp first pole"] == "ideal.gbw is inf"
    assert found["op-amp output resistance"] == "ideal.output_resistance is 0"
    assert "antilog stages and bias current" in found


@pytest.mark.parametrize(
    ("design", "inverters", "bias"),
    [({}, "2 inverters of u", False), ({"bias": False}, "2 inverters of u", True)],
)
def test_an_exponential_board(design: dict[str, Any], inverters: str, bias: bool) -> None:
    found = omissions(amplifier="exponential", **design)
    assert found[inverters] == "their columns have no negative entry"
    assert "antilog stages and bias current" not in found
    assert ("bias current" in found) is bias


def pruned_board(prune: float, **design: Any) -> Circuit:
    scene = make_scene(design={"prune": prune, "resistance": "10kohm", "gain": "1Mohm", **design})
    return synthesise(scene, matrix_problem(PRUNED, [1.0, 2.0, 3.0]))


@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_both_matrices_lose_what_is_below_the_fraction_of_the_largest(topology: str) -> None:
    """The limit of 0.005 is 0.01 of T, and -0.01 stays: it is not below."""
    circuit = pruned_board(0.005, topology=topology)
    kept = np.array(PRUNED)
    kept[2, 0] = 0.0
    assert circuit.realised == pytest.approx(kept, rel=1e-14)
    for matrix in circuit.matrices:
        assert np.array_equal(np.isfinite(matrix.ohms), kept != 0.0)


def test_a_row_without_entries_has_no_op_amps_and_no_strain() -> None:
    circuit = pruned_board(0.01)
    cells = {cell.name for cell in circuit.opamps}
    assert {"c_1", "c_2"} <= cells
    assert not {"c_3", "z_1", "z_2", "z_3"} & cells  # no negative entry is left
    assert {part.name for part in circuit.currents} == {"eps_1", "eps_2"}


def test_the_omission_has_the_numbers() -> None:
    """Left out are 0.01, 0.019, 0.002 and 0.015 of T: 0.0095 of the largest entry at most."""
    found = {item.what: item.why for item in pruned_board(0.01).omissions}
    out, whole = np.array([0.01, 0.019, 0.002, 0.015]), np.linalg.norm(PRUNED)
    assert found["8 pruned matrix resistors"] == (
        "4 entries of T are below design.prune = 0.01 of the largest entry, the largest of them at"
        f" 0.0095; their norm is {np.linalg.norm(out) / whole:.2g} of the norm of T"
    )
    assert found["4 matrix resistors"] == "2 entries of T are zero"
    assert "2 inverters of w" in found


INPUT_T, EPS = [[1.0, -0.5], [0.25, 2.0], [0.5, 0.5]], [0.3, 0.0, -0.2]
G0, GAIN, R, C, GI = 1e-5, 2e5, 1e6, 1e-10, 1e-4
GBW, A0 = 1e6, 1e5
INPUT_DESIGN: dict[str, Any] = {
    "gain": GAIN,
    "unit_conductance": G0,
    "unit_voltage": 2.0,
    "resistance": R,
    "capacitance": C,
    "inverter_resistance": 1 / GI,
    "stray_capacitance": 0,
    "opamp": {
        **{"base": "ideal", "dc_gain": A0, "gbw": GBW, "voltage_noise": 2e-8},
        "output_resistance": 0,
    },
}


def scene(strain_input: str = "voltage", **changes: Any) -> Scene:
    return make_scene(design={**INPUT_DESIGN, "strain_input": strain_input, **changes})


def input_board(strain_input: str, **changes: Any) -> Circuit:
    return synthesise(scene(strain_input, **changes), matrix_problem(INPUT_T, EPS))


def test_the_deck_has_a_voltage_and_a_resistor_for_each_strain() -> None:
    lines = taction.write_deck(
        input_board("voltage"), taction.netlist("scenes/custom-matrix.toml").analysis
    ).text.splitlines()
    assert [line for line in lines if line.startswith(("Re_", "Veps_", "Ieps_"))] == [
        "Re_1 e_1 c_1 99999.99999999999",
        "Re_2 0 c_2 99999.99999999999",
        "Re_3 e_3 c_3 99999.99999999999",
        "Veps_1 e_1 0 0.6",
        "Veps_3 e_3 0 -0.4",
    ]
    assert "* left out: 1 strain voltages; their strain is zero" in lines


def test_the_resistor_has_a_value_of_the_series_and_varies() -> None:
    circuit = input_board("voltage", resistor_series="E96", unit_conductance="8.2uS")
    assert {part.ohms for part in circuit.parts_of(Role.STRAIN_RESISTOR)} == {121e3}
    varied = {parameter.name for parameter in parameters(circuit, scene().tolerances)}
    assert {"Re_1", "Re_2", "Re_3"} <= varied


def test_the_rest_is_that_of_the_currents() -> None:
    """Only the error of the finite gain differs: (1 + s sum G) / A0, of the order of 1e-4 here."""
    ideal = {**INPUT_DESIGN["opamp"], "dc_gain": 1e9}
    pair = [outputs_at_rest(input_board(kind, opamp=ideal)) for kind in ("current", "voltage")]
    assert pair[1] == pytest.approx(pair[0], rel=1e-7)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_a_share_of_the_ridge_term_stays(share: float) -> None:
    """At share 0.5 the current of one resistor of 2 R takes half of that of R."""
    scene = design(amplifier="deadzone", ridge_share=share, gain="1Mohm")
    matrix, eps = np.array([[1.0, 0.3], [0.3, 1.0]]), np.array([3.0, 2.0])
    circuit = build(scene, matrix, eps)
    ohms = [part.ohms for part in circuit.parts_of(Role.RIDGE_RESISTOR)]
    assert ohms == pytest.approx([circuit.value("R") / (1.0 - share)] * 2 if share < 1.0 else [])
    answer = solve(ideal_network(matrix_problem(matrix, eps), scene).problem)
    assert outputs_at_rest(circuit) == pytest.approx(answer.u, rel=1e-3)
