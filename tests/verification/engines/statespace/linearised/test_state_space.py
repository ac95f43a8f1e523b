"""The state space of a board against closed forms; each of its parts is computed once."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.parts import (
    Capacitor,
    OpAmpCell,
    Resistor,
    VoltageSource,
)
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import (
    LinearBoard,
)
from tests.support.boards import bare, kernel, paper_board, strain


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


def recorded(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, name: str
) -> list[tuple[Any, ...]]:
    """Arguments of all calls of a function of a module, from now on."""
    calls: list[tuple[Any, ...]] = []
    honest: Callable[..., Any] = getattr(module, name)

    def wrapped(*args: Any, **named: Any) -> Any:
        calls.append((*args, *named.values()))
        return honest(*args, **named)

    monkeypatch.setattr(module, name, wrapped)
    return calls
