"""What to change: every proposal verified again, edges by winding numbers, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import Point, with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.design import trials
from taction.verification.design.remedies import (
    Remedies,
    find_remedies,
)
from taction.verification.design.trials import OutOfWorkError, Trials
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.report.views.design_view import remedies_text
from taction.verification.stability.poles import count_unstable
from taction.verification.verdict.verify import verify
from tests.support.paths import ROOT

LONG = 1e6  # designs


def paper(changes: Point | None = None, name: str = "paper-breadboard") -> Scene:
    scene = load_scene(ROOT / "scenes" / f"{name}.toml").with_engine("statespace")
    return with_values(scene, changes or {})


@cache
def unstable() -> tuple[Scene, Remedies]:
    scene = paper({"design.capacitance": 5e-12})
    found = find_remedies(verify(scene), LONG)
    assert found is not None
    return scene, found


def test_every_change_of_an_unstable_board_passes_the_whole_verdict() -> None:
    scene, found = unstable()
    assert len(found.changes) == 2
    for change in found.changes:
        assert not change.left
        verdict = verify(with_values(scene, change.values))
        assert verdict.outcome.value == "pass"
        assert verdict.circuit.value("lambda") == pytest.approx(0.7669809, rel=1e-6)  # of the scene


def test_a_rise_between_too_fast_and_too_slow_is_found() -> None:
    """At 8.5 pF the board of the paper is too fast, and at 12.5 pF too slow."""
    scene = paper({"design.capacitance": 8e-12, "design.gain": 6e6})
    found = find_remedies(verify(scene), LONG)
    (farads,) = found.changes[0].values.values()
    assert 8.53e-12 < float(farads) < 1.25e-11
    for change in found.changes:
        verdict = verify(with_values(scene, change.values))
        assert verdict.outcome.value == "pass"


def test_edges_of_stability_by_winding_numbers() -> None:
    """The winding number shares no pole with the search."""
    scene, found = unstable()
    for each, side in zip(found.stability, (1.0, -1.0), strict=True):
        unstable_poles = []
        for distance in (-1e-3, 1e-3):
            value = each.edge * (1.0 + side * distance)
            changes = {each.path: value, "design.lambda": 0.76698091}
            board = LinearBoard(synthesise(with_values(scene, changes)))
            unstable_poles.append(count_unstable(board))
        assert unstable_poles[0] > 0
        assert unstable_poles[1] == 0


def test_opamps_that_make_it_stable_are_named() -> None:
    scene, found = unstable()
    assert "ne5534" in found.opamps
    verdict = verify(with_values(scene, {"design.opamp": "ne5534"}))
    assert verdict.poles.stable
    assert "or with" in remedies_text(scene, found)


def test_a_limit_on_the_settling_time_of_a_slow_board() -> None:
    scene = paper({"design.capacitance": 1e-10}, "tuned-breadboard")
    found = find_remedies(verify(scene), LONG)
    text = remedies_text(scene, found)
    assert "C = 74.5 pF (verified)" in text  # the largest that passes is 77.3 pF
    assert all(not change.left for change in found.changes)


def test_rounded_resistors_are_named_as_the_cause() -> None:
    scene = paper({"design.resistor_series": "E24"}, "tuned-breadboard")
    found = find_remedies(verify(scene), LONG)
    assert found.changes[0].values == {"design.resistor_series": "exact"}


def test_a_limit_of_the_work_says_what_it_left_out() -> None:
    scene = paper({"design.capacitance": 5e-12})
    found = find_remedies(verify(scene), 1e-9)
    assert found.trials == 0
    assert found.cut == (
        ("design.capacitance",),
        ("design.gain",),
        ("design.opamp",),
        ("design.capacitance", "design.gain"),
    )
    assert (
        "searched 0 changes of C, gain, opamp; not to the end: C, gain, opamp, C and gain"
        in remedies_text(scene, found)
    )


def test_the_work_is_counted_and_kept() -> None:
    scene = paper({"design.capacitance": 5e-12})
    found, again = (find_remedies(verify(scene), 60.0) for _ in range(2))
    assert 0 < found.work <= found.limit == 60.0
    assert found == again
    assert found.cut
    trials = Trials(scene, 20.0)
    board = LinearBoard(synthesise(scene))
    with pytest.raises(OutOfWorkError):
        trials.spend(20.0, board)
    trials.spend(1.0, board)
    assert trials.spent == 1.0 + (board.state_space.n / 70.0) ** 3


def test_a_board_that_rings_too_long_is_not_simulated_and_its_reason_is_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(trials, "LONGEST", 1.0)
    made = Trials(paper(name="paper-exponential"))
    found = made.at({"design.capacitance": 5e-11})
    assert found.record.figures["settling_time"] is None
    assert "it rings too long for a search" in found.reason
    scene, remedies = unstable()
    shown = remedies_text(scene, replace(remedies, undecided=(found.reason,)))
    assert f"1 of them without a verdict, such as: {found.reason}" in shown
