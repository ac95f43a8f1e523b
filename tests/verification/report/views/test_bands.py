"""A settling time stands beside its band in every medium that shows one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.report.blocks import PICTURE
from taction.verification.report.renderers.page import page_html
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.verdict_view import screen, view
from taction.verification.report.views.waveforms_view import outputs_chart
from taction.verification.verdict.cause import cause
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify

BOARD = "scenes/known-readings.toml"
BAND = "to ±2.5 %"


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene whose band is no round number, so that no text has it by chance."""
    scene = with_values(load_scene(BOARD), {"checks.settling_time.band": 0.025})
    free = scene.checks.settling_time.model_copy(update={"min": None, "max": 1e-3})
    checks = scene.checks.model_copy(update={"settling_time": free})
    place = tmp_path_factory.mktemp("bands") / "board.toml"
    found = scene.model_copy(update={"checks": checks}).with_engine("statespace")
    place.write_text(scene_text(found), encoding="utf-8")
    return place


def test_verdicts_in_every_medium(file: Path) -> None:
    verdict = verify(load_scene(file))
    whole = view(verdict)
    for text in (page_text(whole), page_text(screen(verdict)), page_html(whole)):
        assert re.search(rf"[Ss]ettl\w* {BAND}", re.sub(r"\s+", " ", text))
    assert BAND in next(iter(whole.blocks(PICTURE))).title
    slow = [replace(c, expected=1e-9) for c in verdict.checks if c.name == "settling_time"]
    late = cause([replace(c, outcome=Outcome.FAIL) for c in slow])
    assert late is not None
    assert late.text.startswith(f"settles {BAND} in ")


def test_a_board_that_grows_opens_on_its_growth() -> None:
    """At the end of the first view the outputs are far above those of its first tenth."""
    board = with_values(load_scene(BOARD), {"design.capacitance": 1e-12})
    verdict = verify(board.with_engine("statespace"))
    assert verdict.poles.known_unstable
    first = outputs_chart(verdict).views[0]
    assert first.x is not None
    time, sizes = verdict.waveforms.time, abs(verdict.u).max(axis=1)
    early = sizes[time <= 0.1 * first.x[1]].max()
    assert sizes[time <= first.x[1]].max() > 3.0 * early


def test_a_board_that_grows_has_no_excursions_in_any_record() -> None:
    """That of its record depends on its length."""
    boards = (with_values(load_scene(BOARD), {"design.capacitance": c}) for c in (1e-12, 1e-11))
    grows, rests = (Record.of(verify(each.with_engine("statespace"))) for each in boards)
    assert (grows.stable, rests.stable) == (False, True)
    for one, other in zip((grows, *grows.channels), (rests, *rests.channels), strict=True):
        assert one.figure("rise_time").value is None
        for name in ("overshoot", "undershoot"):
            assert one.figure(name).value is None
            assert other.figure(name).value is not None
