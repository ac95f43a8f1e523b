"""A large board's transient from one Krylov space, held against its modes and a matrix exponential.

The boards are small, so that the exact answer is known; the module does not care.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Floats
from spice_models.errors import EngineError
from spice_models.opamp import OpAmp
from tests.support.boards import board, kernel, paper_board, strain, two_pole
from verification.engines.statespace.equations import descriptor
from verification.engines.statespace.equations.stamps import stamp
from verification.engines.statespace.equations.structured_solve import Structure
from verification.engines.statespace.transients import reduced_order, structured_radau
from verification.engines.statespace.transients.exact import exact_solution, simulate
from verification.engines.statespace.transients.krylov_space import Ritz, Space
from verification.engines.statespace.transients.reduced_order import reduced


def wide_board(channels: int, C: float = 20e-12, *, bias: bool = False) -> Circuit:
    """The paper's board with more channels and as much conductance at every node."""
    T, eps = kernel(channels, 3.0), strain(channels, 3.0)
    model = two_pole(790e3, 12e-12)
    return board(T, eps, model, G0=0.3313e-6 * 7 / channels, C=C, bias=bias)


def scattered(circuit: Circuit, share: float) -> Circuit:
    """A board with parts of a normal spread: no symmetry is left."""
    rng = np.random.default_rng(7)

    def near(values: Floats) -> Floats:
        return np.asarray(values * (1.0 + share * rng.standard_normal(np.shape(values))))

    parts = circuit.capacitors
    farads = near(np.array([part.farads for part in parts])).tolist()
    return replace(
        circuit,
        matrices=tuple(replace(part, ohms=near(part.ohms)) for part in circuit.matrices),
        capacitors=tuple(replace(p, farads=f) for p, f in zip(parts, farads, strict=True)),
    )


def rectangular_board() -> Circuit:
    """Twenty sensors, thirty channels, entries that are zero, and slow stiff parts."""
    T = np.random.default_rng(3).standard_normal((20, 30))
    T[np.abs(T) < 0.3] = 0.0
    eps = np.linspace(-1.0, 1.0, 20)
    return board(T, eps, two_pole(1e6, 5e-12), G0=0.25e-6, R=1e6, s=1e5, C=640e-12)


CASES = [
    (wide_board(16), Transient(1e-3, 1e-6)),
    (wide_board(32), Transient(1e-3, 1e-6)),
    (wide_board(16, C=1e-9), Transient(2e-2, 1e-5)),
    (wide_board(24, bias=True), Transient(5e-4, 1e-6, initial="rest")),
    (wide_board(16), Transient(5e-4, 1e-6, voltages={"v2": 0.1, "x2": 1e-3})),
    (scattered(wide_board(16), 0.05), Transient(1e-3, 1e-6)),
    (rectangular_board(), Transient(1e-2, 1e-5)),
    (paper_board(9.2e-12), Transient(2e-2, 1e-6)),
]


@pytest.mark.parametrize(("circuit", "analysis"), CASES)
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_the_error_is_below_the_one_stated(
    circuit: Circuit, analysis: Transient, tolerance: float
) -> None:
    found = reduced(circuit, analysis, tolerance=tolerance)
    solution = exact_solution(circuit, initial=analysis.initial, voltages=analysis.voltages)
    early = analysis.stop * 10.0 ** np.linspace(-10.0, 0.0, 400)
    times = np.sort(np.concatenate([np.linspace(0.0, analysis.stop, 1501), early]))
    error = float(np.abs(found.at(times) - solution.at(times)).max())
    start = float(np.abs(solution.at(times[:1]) - solution.final).max())
    assert found.amplitude == pytest.approx(start, rel=1e-6)
    assert error <= found.error <= tolerance * start
    assert found.dimension <= reduced_order.LARGEST


def test_a_record_at_even_instants_is_the_one_at_any() -> None:
    found = reduced(wide_board(16), Transient(1e-3, 1e-6), nodes=("v3", "w0"))
    for count in (1, 2, 7, 1001):
        times = 1e-6 * np.arange(count, dtype=np.float64)
        assert found.uniform(1e-6, count) == pytest.approx(found.at(times), abs=1e-12)


def test_a_space_projects_the_inverse_that_it_is_made_of() -> None:
    equations = stamp(scattered(wide_board(6), 0.01))
    structure, shift = Structure(equations), 2e5
    charge = structure.mass @ np.random.default_rng(1).standard_normal(equations.size)
    watch = np.arange(equations.size)
    space = Space(structure, shift, charge, watch, 30)
    assert space.grow(30)
    M, K = equations.dense.mass, equations.dense.stiffness
    Q = space.weight[:, None] * space.Q.T
    X = np.linalg.solve(shift * M - K, Q)
    assert np.abs(space.X.T - X).max() < 1e-9 * np.abs(X).max()
    gram = space.Q @ space.Q.T
    assert np.abs(gram - np.eye(31)).max() < 1e-13
    image = (M @ X[:, :30]) / space.weight[:, None]
    assert image == pytest.approx(space.Q.T @ space.H, abs=1e-12 * np.abs(image).max())


def test_a_space_that_holds_all_there_is_grows_no_further() -> None:
    equations = stamp(paper_board(20e-12))
    structure = Structure(equations)
    charge = structure.mass @ np.ones(equations.size)
    space = Space(structure, 2e5, charge, np.arange(3), 120)
    assert not space.grow(120)
    assert space.m <= 91  # states


def test_poles_right_of_the_axis_are_not_believed() -> None:
    share = np.ones((1, 1), dtype=np.complex128)
    for pole, kept in ((-1.0, True), (1e-7, True), (1e-3, False), (np.nan, False)):
        assert Ritz(np.array([pole], dtype=np.complex128), share).stable(1.0) is kept


def test_an_unstable_board_takes_steps_and_says_so() -> None:
    circuit, analysis = wide_board(12, C=5e-12), Transient(3e-3, 1e-6)
    with pytest.raises(EngineError, match="coarse board is unstable"):
        reduced(circuit, analysis)
    found = reduced_order.simulate(circuit, analysis)
    assert found.values == pytest.approx(structured_radau.simulate(circuit, analysis).values)
    assert found.flags == ("implicit steps: the coarse board is unstable",)


def test_an_instability_that_has_not_grown_yet_is_found_in_the_space() -> None:
    with pytest.raises(EngineError, match="pole right of the imaginary axis"):
        reduced(wide_board(12, C=5e-12), Transient(3e-5, 1e-6))


@pytest.mark.parametrize(
    ("circuit", "analysis", "tolerance", "message"),
    [
        (wide_board(8), Transient(1e-3, 1e-6), 1e-8, "too close to rounding"),
        (replace(wide_board(8), currents=()), Transient(1e-3, 1e-6), 1e-5, "do not move"),
    ],
)
def test_what_cannot_be_shown_is_refused(
    circuit: Circuit, analysis: Transient, tolerance: float, message: str
) -> None:
    with pytest.raises(EngineError, match=message):
        reduced(circuit, analysis, tolerance=tolerance)
    found = reduced_order.simulate(circuit, replace(analysis, stop=1e-5), tolerance=tolerance)
    assert len(found.flags) == 1
    assert message in found.flags[0]


def test_charges_that_are_at_rest_span_no_space(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reduced_order, "_shift", lambda *_: (1e6, 1e9))
    with pytest.raises(EngineError, match="at rest from the start"):
        reduced(replace(wide_board(8), currents=()), Transient(1e-3, 1e-6))


def test_a_board_without_charges_is_left_to_the_steps() -> None:
    resistive = replace(paper_board(), models={"two_pole": OpAmp("two_pole", 1e8)}, capacitors=())
    found = reduced_order.simulate(resistive, Transient(1e-5, 1e-6))
    assert "do not move" in found.flags[0]
    assert np.ptp(found.values, axis=0).max() == 0.0


def test_a_space_too_small_for_its_board_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reduced_order, "LARGEST", 24)
    with pytest.raises(EngineError, match="of 24 dimensions does not suffice: it does not conv"):
        reduced(scattered(wide_board(16), 0.05), Transient(1e-3, 1e-6))


def test_a_board_of_exponential_amplifiers_is_refused() -> None:
    T, eps = kernel(3, 1.0), strain(3, 1.0)
    circuit = board(T, eps, two_pole(790e3, 12e-12), exponential=True, bias=True)
    with pytest.raises(EngineError, match="linear boards"):
        reduced(circuit, Transient(1e-4, 1e-6))


def test_a_large_board_takes_a_krylov_space_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    circuit = wide_board(16)
    monkeypatch.setattr(descriptor, "LARGE", 0)
    times = np.linspace(0.0, 2e-4, 101)
    found = simulate(circuit, Transient(2e-4, 1e-6), times=times)
    assert not found.flags
    assert found.cost.factorisations == 3
    wanted = exact_solution(circuit).at(times)
    assert np.abs(found.values - wanted).max() < 1e-6 * np.abs(wanted).max()
    even = simulate(circuit, Transient(2e-4, 2e-6))
    assert even.values == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())
