"""Structured solves, steps, pole search and pole count of large boards, against dense ones."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.equations.structured_solve import Structure, coarsen
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.engines.statespace.linearised.rightmost_poles import rightmost_poles
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.stability.poles import poles
from tests.support.boards import board, drawn_board, kernel, paper_board, strain, two_pole


def wide_board(channels: int, C: float = 10e-12) -> Circuit:
    """The paper's board with more channels and as much conductance at every node."""
    T, eps = kernel(channels, 3.0), strain(channels, 3.0)
    model = two_pole(790e3, 12e-12)
    return board(T, eps, model, G0=0.3313e-6 * 7 / channels, C=C)


def exponential_board(channels: int) -> Circuit:
    T, eps = kernel(channels, 3.0), np.maximum(strain(channels, 3.0), 0.05)
    model = two_pole(790e3, 12e-12)
    return board(T, eps, model, G0=0.3313e-6 * 7 / channels, exponential=True, bias=True, C=20e-12)


def rectangular_board() -> Circuit:
    """Five sensors, nine channels, and entries that are zero."""
    T = np.random.default_rng(3).standard_normal((5, 9))
    T[np.abs(T) < 0.3] = 0.0
    return board(T, np.linspace(-1.0, 1.0, 5), two_pole(1e6, 5e-12), G0=1e-6, R=1e5, s=1e5)


@pytest.mark.parametrize("circuit", [paper_board(), rectangular_board(), exponential_board(7)])
@pytest.mark.parametrize("shift", [0.0, 3e6, 1e4 - 2.5e5j])
def test_a_structured_solve_is_the_dense_one(circuit: Circuit, shift: complex) -> None:
    equations = stamp(circuit)
    slopes = np.linspace(-2.0, -1.0, equations.devices.count)
    K = equations.dense.stiffness.copy()
    K[equations.devices.output, equations.devices.input] += slopes
    r = np.random.default_rng(1).standard_normal(equations.size)
    structure, pencil = Structure(equations, slopes), shift * equations.dense.mass - K
    for each, matrix in ((structure.transposed, pencil.T), (structure, pencil)):
        wanted = np.linalg.solve(matrix, r)
        found = each.factor(shift)(r.astype(np.complex128) if np.imag(shift) else r)
        assert found == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    assert max(places.shape[1] for places, *_ in structure.groups) <= 16
    columns = np.stack([r, np.roll(r, 1)], axis=1).astype(np.complex128)
    both = structure.factor(shift)(columns)
    assert both[:, 0] == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("circuit", [paper_board(), rectangular_board(), exponential_board(7)])
def test_the_sensitivities_of_a_large_board_are_the_dense_ones(
    circuit: Circuit, monkeypatch: pytest.MonkeyPatch
) -> None:
    dense = RestSensitivity.of(LinearBoard(circuit)).adjoint
    monkeypatch.setattr(descriptor, "LARGE", 0)
    found = RestSensitivity.of(LinearBoard(circuit)).adjoint
    np.testing.assert_allclose(found, dense, rtol=0.0, atol=1e-9 * np.abs(dense).max())


@pytest.mark.parametrize(
    "circuit", [wide_board(40), wide_board(40, C=5e-12), exponential_board(40)]
)
def test_rightmost_poles_of_a_wide_board_are_the_dense_ones(circuit: Circuit) -> None:
    found = poles(circuit)
    assert not found.complete
    dense = np.linalg.eigvals(LinearBoard(circuit).state_space.A)
    lead = dense[np.argmax(dense.real)]
    assert found.rightmost == pytest.approx(complex(lead.real, abs(lead.imag)), rel=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_errors_of_the_rightmost_poles_hold(seed: int) -> None:
    circuit = drawn_board(seed, 20)
    found, modes = rightmost_poles(LinearBoard(circuit)), LinearBoard(circuit).state_space.modes
    nearest = np.abs(modes.poles[:, None] - found.poles).argmin(axis=0)
    off = np.abs(modes.poles[nearest] - found.poles)
    assert np.all(off <= found.errors + modes.pole_errors[nearest])
    missed = modes.poles.real > found.poles[0].real + found.errors[0] + modes.pole_errors
    assert not missed.any()
    assert found.errors[0] <= 1e-3 * abs(found.poles[0])


def test_a_coarse_board_is_a_guide_to_the_whole() -> None:
    whole = LinearBoard(wide_board(40))
    coarse = whole.coarse
    assert set(coarse.descriptor.names) < set(whole.descriptor.names)
    assert coarse.state_space.n == 14 * 13
    guide = poles(whole)
    near = np.linalg.eigvals(coarse.state_space.A)
    lead = near[np.argmax(near.real)]
    assert abs(lead.imag) == pytest.approx(guide.rightmost.imag, rel=1e-3)
    assert coarsen(stamp(paper_board())).names == stamp(paper_board()).names
    assert "bias" in coarsen(stamp(exponential_board(30))).names
    assert rightmost_poles(LinearBoard(paper_board())).poles[0] == pytest.approx(
        complex(poles(paper_board()).rightmost), rel=1e-8
    )


def test_slow_poles_that_no_coarse_board_has_are_found() -> None:
    """Pairs of channels that do not touch: every k-th channel shows no slow mode of a pair."""
    T = np.zeros((30, 30))
    for k in range(0, 30, 2):
        T[k : k + 2, k : k + 2] = [[1.0, 0.999 - 0.01 * k], [0.9, 1.0 + 0.01 * k]]
    whole = LinearBoard(board(T, np.ones(30), two_pole(1e7, 5e-12), G0=1e-5, R=1e6, s=1e5, C=1e-9))
    exact = np.linalg.eigvals(whole.state_space.A)
    assert rightmost_poles(whole).poles[0] == pytest.approx(exact[np.argmax(exact.real)], rel=1e-6)


@pytest.mark.parametrize(
    "analysis",
    [
        Transient(1e-3, 1e-6),
        Transient(1e-4, 1e-6, initial="rest"),
        Transient(1e-4, 1e-6, voltages={"v_3": 0.1, "x_3": 1e-3}),
    ],
)
def test_steps_agree_with_the_exact_transient(analysis: Transient) -> None:
    circuit = paper_board()
    found = stepped.integrate(circuit, analysis, nodes=("v_4", "v_1", "w_4"))
    solution = exact_solution(
        circuit, initial=analysis.initial, voltages=analysis.voltages, nodes=found.nodes
    )
    wanted = solution.at(found.time)
    assert found.time[-1] == analysis.stop
    assert np.abs(found.values - wanted).max() < 5e-5 * np.abs(wanted).max()
    tight = stepped.integrate(circuit, analysis, nodes=found.nodes, tolerance=1e-9)
    assert np.abs(tight.values - wanted).max() < 1e-7 * np.abs(wanted).max()
    assert 0 < found.cost.points < 500


def test_an_unstable_board_grows_as_its_pole_says_and_its_record_ends() -> None:
    circuit = paper_board(5e-12)
    found = stepped.integrate(circuit, Transient(2e-3, 1e-6))
    wanted = exact_solution(circuit).at(found.time)
    error = np.abs(found.values - wanted).max(axis=1)
    size = np.maximum.accumulate(np.abs(wanted).max(axis=1))
    assert np.all(error < 1e-3 * size + 1e-12)
    long = stepped.integrate(circuit, Transient(1e-2, 1e-6))
    assert long.time[-1] < 1e-2
    assert "diverges" in long.flags[0]


@pytest.mark.parametrize(
    ("circuit", "analysis"),
    [
        (exponential_board(5), Transient(1e-4, 1e-6)),
        (exponential_board(5), Transient(1e-4, 1e-6, initial="rest")),
        (exponential_board(5), Transient(1e-4, 1e-6, voltages={"v_3": -0.4})),
        (wide_board(5), Transient(1e-4, 1e-6)),
    ],
)
def test_a_large_exponential_board_takes_the_same_course(
    circuit: Circuit, analysis: Transient, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = (*(output.node for output in circuit.outputs), "w_3")
    wanted = stepped.integrate(circuit, analysis, nodes=nodes)
    monkeypatch.setattr(descriptor, "LARGE", 0)
    found = stepped.integrate(circuit, analysis, nodes=nodes)
    assert np.abs(found.values - wanted.values).max() < 1e-8 * np.abs(wanted.values).max()


def test_a_large_exponential_board_beyond_all_bounds_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(descriptor, "LARGE", 0)
    far = Transient(1e-4, 1e-6, voltages={"v_2": 1e4})
    with pytest.raises(EngineError, match="beyond the range of floats in the initial state"):
        stepped.integrate(exponential_board(3), far)


def test_parts_that_cancel_at_one_value_only() -> None:
    """-1 kohm and R2 in parallel: at 1 kohm nothing is left of their sum, but of their rounding."""
    cards = ["v1 in 0 1", "r0 in a 3k", "r1 a 0 -1k", "r2 a 0 1k", "c1 a 0 1n", "r3 a 0 7k"]
    board = circuit_of(read_cards(cards), "cancelling", ["a"])
    for one in (board.turned("R2", ohms) for ohms in (500.0, 1000.0, 2000.0)):
        found = stamp(one)
        siemens = 1.0 / 1e3 - 1.0 / 3e3 - 1.0 / 7e3 - 1.0 / one.value("R2")
        assert found.dense.stiffness[1, 1] == pytest.approx(siemens)
        _, sizes = found.summed(np.abs, np.zeros(0))
        siemens = 1.0 / 1e3 + 1.0 / 3e3 + 1.0 / 7e3 + 1.0 / one.value("R2")
        assert sizes[1, 1] == pytest.approx(siemens)


def test_a_part_within_one_row_adds_exactly_nothing() -> None:
    """R2 is parallel to V2: nothing of it is left, neither of its value nor of its rounding."""
    cards = ["v1 in 0 1", "r1 in a 1k", "v2 a b 0.0", "r2 a b 1m", "c1 b 0 1n"]
    found = stamp(circuit_of(read_cards(cards), "parallel", ["a"]))
    _, sizes = found.summed(np.abs, np.zeros(0))
    assert sizes.max() == pytest.approx(1.0)  # of the laws; R2 has 1000 S
    assert len(found.local.values) == len(
        stamp(
            circuit_of(
                read_cards([card for card in cards if not card.startswith("r2")]), "without", ["a"]
            )
        ).local.values
    )
