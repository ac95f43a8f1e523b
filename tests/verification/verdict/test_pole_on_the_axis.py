"""A pole within its rounding error of the axis: the sign of the rounding error decides nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales
from taction.verification.evidence.stress.catalogue import load_catalogue
from taction.verification.stability.poles import Poles, poles_behind
from taction.verification.verdict import design
from taction.verification.verdict.design import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.progress import Clock
from taction.verification.verdict.verify import verify


@pytest.fixture(scope="module")
def scene() -> Scene:
    return next(case for case in load_catalogue() if case.name == "onset-itself").scene()


def shifted(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """Move the rightmost pair of poles by a share of its rounding error."""

    def moved(board: LinearBoard, scales: TimeScales) -> Poles:
        found = poles_behind(board, scales)
        poles = found.poles.copy()
        poles[:2] = share * found.errors[:2] + 1j * poles[:2].imag
        rightmost = complex(poles[0].real, abs(poles[0].imag))
        return replace(found, poles=poles, rightmost=rightmost, stable=rightmost.real < 0.0)

    monkeypatch.setattr(design, "poles_behind", moved)


def designed(scene: Scene) -> PlannedBoard:
    return design_board(scene, Clock(lambda stage: None))


def test_the_board_and_its_deck_are_the_same(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    decks = set()
    for share in (-0.5, 0.5):
        shifted(monkeypatch, share)
        found = designed(scene)
        assert not found.poles.known_stable
        assert not found.poles.known_unstable
        decks.add(write_deck(found.circuit, found.transient).text)
    assert len(decks) == 1


@pytest.mark.parametrize("engine", ["statespace", "ngspice"])
def test_the_verdict_is_the_same(
    scene: Scene, engine: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    if engine == "ngspice":
        request.getfixturevalue("ngspice")
    asked = scene.model_copy(
        update={"analysis": scene.analysis.model_copy(update={"engine": engine})}
    )
    outcomes = []
    for share in (-0.5, 0.5):
        shifted(monkeypatch, share)
        outcomes.append({c.name: c.outcome.value for c in verify(asked).checks})
    assert outcomes[0] == outcomes[1]
    assert outcomes[0]["stability"] == "inconclusive"
