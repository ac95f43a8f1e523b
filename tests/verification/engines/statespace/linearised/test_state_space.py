"""The state space of a board against closed forms; each of its parts is computed once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.parts import Capacitor, OpAmpCell, Resistor, VoltageSource
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.foreign_board import stepped
from tests.support.boards import bare, kernel, paper_board, strain
from tests.support.nodal_analysis import exact_poles


def poles_of(**parts: Any) -> Floats:
    space = LinearBoard(bare(**parts)).state_space
    return np.asarray(np.sort(np.linalg.eigvals(space.A).real))


def test_an_rc_stage_has_its_pole_and_its_gain() -> None:
    space = LinearBoard(
        bare(
            resistors=(Resistor("R", "in", "out", 2e3),),
            capacitors=(Capacitor("C", "out", "0", 1e-9),),
            voltages=(VoltageSource("V", "in", 3.0),),
        )
    ).state_space
    assert space.states == ("out",)
    assert pytest.approx(np.array([[-1.0 / 2e-6]]), rel=1e-15) == space.A
    assert pytest.approx(np.array([[0.0, 3.0 / 2e-6]]), rel=1e-15) == space.B
    C, D = space.rows(("in", "out", "0"))
    assert C.ravel().tolist() == [0.0, 1.0, 0.0]
    assert D[:, 1].tolist() == [3.0, 0.0, 0.0]


def test_a_follower_has_the_poles_of_its_quadratic() -> None:
    gbw, second, gain = 1e6, 3e6, 1e5
    values = LinearBoard(
        bare(
            models={"op": OpAmp("op", gain, gbw=gbw, second_pole=second)},
            opamps=(OpAmpCell("X", "op", "in", "out", "out"),),
            voltages=(VoltageSource("V", "in", 1.0),),
        )
    ).state_space
    p1, p2 = 2 * np.pi * gbw / gain, 2 * np.pi * second
    wanted = np.roots([1.0, p1 + p2, p1 * p2 * (1.0 + gain)])
    found = np.linalg.eigvals(values.A)
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(wanted), rel=1e-12)


def test_output_resistance_and_input_capacitances_by_hand() -> None:
    gain, rin, ro, cd, ci, load = 100.0, 1e6, 50.0, 2e-12, 3e-12, 1e3
    model = OpAmp("op", gain, np.inf, np.inf, rin, cd, ci, ro)
    values = poles_of(
        models={"op": model},
        opamps=(OpAmpCell("X", "op", "0", "x", "out"),),
        resistors=(Resistor("Rf", "x", "out", 1e4), Resistor("Rl", "out", "0", load)),
    )
    # Output: (-gain x - out)/ro - out/load + (x - out)/1e4 = 0; input: both capacitances on x.
    out = (1e-4 - gain / ro) / (1.0 / ro + 1.0 / load + 1e-4)
    assert values == pytest.approx([-(1.0 / rin + 1e-4 * (1.0 - out)) / (cd + ci)], rel=1e-12)


def test_the_state_space_rests_where_the_regularised_problem_has_its_solution() -> None:
    circuit = paper_board()
    T, eps, lam = kernel(7, 3.0), strain(7, 3.0), circuit.value("lambda")
    wanted = np.linalg.solve(T.T @ T + lam * np.eye(7), T.T @ eps)
    space = LinearBoard(circuit).state_space
    C, D = space.rows(circuit.signal_nodes)
    found = D.sum(axis=1) - C @ np.linalg.solve(space.A, space.B.sum(axis=1))
    assert found == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("parts", "telling"),
    [
        ({"resistors": (Resistor("R", "a", "b", 1e3),)}, "undetermined: a, b"),
        (
            {"voltages": (VoltageSource("V", "a", 1.0), VoltageSource("W", "a", 2.0))},
            "W drives a node",
        ),
        ({"voltages": (VoltageSource("V", "0", 1.0),)}, "V drives a node"),
    ],
)
def test_what_has_no_state_space_is_refused_by_name(parts: dict[str, Any], telling: str) -> None:
    with pytest.raises(EngineError, match=telling):
        _ = LinearBoard(bare(**parts)).state_space


@pytest.mark.parametrize("ratio", [1e3, 1e7, 1e9, 1e11])
def test_a_large_capacitor_between_small_ones_keeps_its_slow_pole(ratio: float) -> None:
    """C between two nodes with R and a small c each: sum and difference of the voltages decay.

    The sum C + c has lost digits of c before any pole is computed, and so has the fast pole.
    """
    c, C, R = 1e-12, 1e-12 * ratio, 1e6
    poles = poles_of(
        resistors=(Resistor("a", "x", "0", R), Resistor("b", "y", "0", R)),
        capacitors=(
            Capacitor("a", "x", "0", c),
            Capacitor("b", "y", "0", c),
            Capacitor("c", "x", "y", C),
        ),
    )
    assert poles[0] == pytest.approx(-1 / (R * c), rel=1e-15 * ratio + 1e-12)
    assert poles[1] == pytest.approx(-1 / (R * (c + 2 * C)), rel=1e-12)


TAU = 1e-6  # s: 1 kohm and 1 nF
TIMES = np.array([1e-8, 1e-7, 1e-6, 3e-6])
SLOW = ("v1 in 0 ac 1", "r1 in a 1k", "c1 a 0 1n")
LOAD = ("r3 o 0 1k", "c2 o 0 1n")


def board(*cards: str) -> LinearBoard:
    flat, _ = stepped(read_cards(cards))
    return LinearBoard(circuit_of(flat, "a", ["o"]))


def test_a_coil_in_series_with_a_current_source_is_no_state() -> None:
    """Two poles at 1/tau: v(o) = 1 - (1 + t/tau) exp(-t/tau)."""
    made = board(*SLOW, "g1 0 x a 0 1m", "l1 x y 1m", "r2 y o 1k", *LOAD)
    np.testing.assert_allclose(made.state_space.n, 2)
    np.testing.assert_allclose(poles(made).poles, [-1.0 / TAU] * 2, rtol=1e-9)
    found = exact_solution(made, initial="rest").at(TIMES)[:, 0]
    wanted = 1.0 - (1.0 + TIMES / TAU) * np.exp(-TIMES / TAU)
    np.testing.assert_allclose(found, wanted, atol=1e-8)


def test_a_step_in_such_a_current_moves_no_charge() -> None:
    """The current of the coil jumps with the source: v(o) = 1 - exp(-t/tau) from 0."""
    made = board("v1 in 0 ac 1", "g1 0 x in 0 1m", "l1 x o 1m", *LOAD)
    np.testing.assert_allclose(poles(made).poles, [-1.0 / TAU], rtol=1e-9)
    found = exact_solution(made, initial="rest").at(TIMES)[:, 0]
    np.testing.assert_allclose(found, 1.0 - np.exp(-TIMES / TAU), atol=1e-9)


@pytest.mark.parametrize("small", [1.0, 1e-10])
def test_coils_in_series_are_one_state(small: float) -> None:
    """-R / (L1 + L2), beside a node that 1e12 ohm hold."""
    made = board(
        "v1 in 0 ac 1",
        "l1 in x 1m",
        "l2 x o 2m",
        f"r1 o 0 {small!r}",
        "r2 in q 1e12",
        "r4 q 0 1e12",
    )
    np.testing.assert_allclose(poles(made).poles, [-small / 3e-3], rtol=1e-8)


def test_a_current_beside_nodes_that_capacitors_join_is_no_equation_of_rounding() -> None:
    """A vendor's op-amp: the current of V5, which a capacitor takes from X, returns through F2.

    What rounding leaves of this current in the voltages of the capacitors is none of it.
    """
    cards = [
        *("v1 in 0 1", "e1 r 0 s 0 1", "e2 a b in r 50", "e3 b r out r 50", "v5 x y 0"),
        *("f2 0 x v5 1", "r4 p 0 6", "r17 x 0 110", "c1 in out 5p", "c8 a t 100p", "c9 u r 10p"),
        *("cf s 0 1u", "cj1 out q 0.6p", "cj2 p w 0.25p", "cj3 w q 0.6p", "cd y u 0.8p"),
        *("r1 in out 1k", "r2 t 0 1", "r3 u 0 1k", "r5 s 0 250k", "r6 q 0 10", "e4 w 0 t 0 1"),
    ]
    wanted = exact_poles(cards)
    found = poles(LinearBoard(circuit_of(read_cards(cards), "a", ["out"])))
    np.testing.assert_allclose(found.poles, sorted(wanted, key=lambda p: -p.real))


def test_a_limit_beside_large_conductances_is_known_to_all_digits() -> None:
    """The coil of a vendor's common mode, which 10 nS feed, beside 50 uS at 0.2 pF."""
    cards = [
        *("v1 in 0 1", "r8 in s 1e6", "r9 s out 2e6", "c9 s out 1p", "r1 s h 1e12", "r2 h 0 1e12"),
        *("g4 0 m h 0 1e-8", "l2 0 l 530", "r13 l m 1k", "g1 p 0 m s 5e-5", "g2 q 0 s m 5e-5"),
        *("r3 p 0 20k", "r4 q 0 20k", "c4 p q 0.2p", "g5 0 z q p 2m", "r5 z 0 1e8", "c3 z 0 50p"),
        *("e1 y 0 z 0 1", "r16 y out 20"),
    ]
    wanted = sorted(exact_poles(cards), key=lambda p: (-p.real, -p.imag))
    space = LinearBoard(circuit_of(read_cards(cards), "a", ["out"])).state_space
    raw = np.linalg.eigvals(space.A)  # nothing corrects them
    np.testing.assert_allclose(raw[np.lexsort((-raw.imag, -raw.real))], wanted, rtol=1e-7)
