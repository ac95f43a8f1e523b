"""A linearised board computes each part once, also over a whole verification."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import load_scene
from taction.verification.engines.statespace.linearised import board as board_module
from taction.verification.engines.statespace.linearised import state_space as state_space_module
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.verdict import transient_plan
from taction.verification.verdict.verify import verify
from tests.support.boards import paper_board, single_mode
from tests.support.paths import SCENES

STATES = 91  # of the shipped boards


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


def test_a_part_is_the_same_however_often_it_is_asked_for() -> None:
    board = LinearBoard(paper_board())
    for name in ("descriptor", "equilibrium", "rest", "state_space", "open_loop", "structure"):
        assert getattr(board, name) is getattr(board, name)
    assert board.state_space.modes is board.state_space.modes
    assert board.state_space.descriptor is board.descriptor
    assert LinearBoard.of(board) is board
    assert LinearBoard.of(board.circuit).circuit is board.circuit


def test_the_linearisation_of_a_linear_board_needs_no_equilibrium(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solved = recorded(monkeypatch, board_module, "solve_equilibrium")
    board = LinearBoard(single_mode(1e-6))
    assert board.state_space.n > 0
    assert not solved
    assert (board.equilibrium["v"] != 0.0, board.rest["v"]) == (True, 0.0)
    assert len(solved) == 2


@pytest.mark.parametrize(
    ("scene", "values"),
    [
        ("tuned-breadboard", {"analysis.engine": "statespace", "analysis.error": 1e-4}),
        ("tuned-breadboard", {"analysis.engine": "ngspice"}),
        ("tuned-breadboard", {"analysis.engine": "ngspice", "analysis.error": 1e-4}),
        ("paper-exponential", {"analysis.engine": "statespace", "analysis.error": 1e-3}),
    ],
)
def test_one_verification_computes_nothing_twice(
    ngspice: str, monkeypatch: pytest.MonkeyPatch, scene: str, values: dict[str, float | str]
) -> None:
    """Also where the first try of a step misses the error, as the third scene's is made to do."""
    monkeypatch.setattr(transient_plan, "AIM", 3.0)
    stamped = recorded(monkeypatch, board_module, "stamp")
    factorised = recorded(monkeypatch, board_module, "dense_response")
    solved = recorded(monkeypatch, board_module, "solve_equilibrium")
    linearised = recorded(monkeypatch, board_module, "linearise")
    decomposed = recorded(monkeypatch, state_space_module, "decompose")
    verdict = verify(with_values(load_scene(SCENES / f"{scene}.toml"), values))
    assert sum(circuit is verdict.circuit for (circuit,) in stamped) == 1
    for calls in (factorised, linearised):
        assert len({id(descriptor) for descriptor, *_ in calls}) == len(calls)
    assert len({(id(descriptor), *switch) for descriptor, _, *switch in solved}) == len(solved)
    sizes = [sum(len(A) for A in blocks) for blocks, *_ in decomposed]
    assert sizes.count(STATES) == 1
    if values["analysis.engine"] == "ngspice":
        assert verdict.accuracy.tries == 2
