"""A settling time stands beside its band in every medium that shows one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.loading import load_scene
from taction.system.charts import Chart
from taction.system.documents import plain
from taction.verification.report.blocks import PICTURE, Table
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.junit import files_junit
from taction.verification.report.renderers.markdown import markdown
from taction.verification.report.renderers.page import page_html
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.answer_view import check_bar
from taction.verification.report.views.comparison_view import files_view
from taction.verification.report.views.verdict_view import screen, view
from taction.verification.report.views.waveforms_view import outputs_chart
from taction.verification.studies.scene_files import VerifiedFiles
from taction.verification.verdict.cause import cause
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify
from tests.support.report_pages import STUDIES, page

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
    for text in (page_text(whole), page_text(screen(verdict)), markdown(whole), page_html(whole)):
        assert re.search(rf"[Ss]ettl\w* {BAND}", re.sub(r"\s+", " ", text))
    assert BAND in next(iter(whole.blocks(PICTURE))).heading
    slow = [replace(c, expected=1e-9) for c in verdict.checks if c.name == "settling_time"]
    late = cause([replace(c, outcome=Outcome.FAIL) for c in slow])
    assert late is not None
    assert late.text.startswith(f"settles {BAND} in ")


def test_a_time_that_is_not_known_has_its_band_too(file: Path) -> None:
    """On the screen, in JSON and in JUnit: the record is too short, or the board grows."""
    short = with_values(load_scene(file), {"checks.settling_time.max": 1e-9})
    grown = with_values(short, {"design.capacitance": 1e-12})
    for scene in (short, grown):
        verdict = verify(scene)
        found = next(c for c in verdict.checks if c.name == "settling_time")
        lost = replace(found, value=None, reason="outside after 1 ns, the limit")
        assert check_bar(lost).name == f"settling {BAND}"
        document = verdict_document(verdict) | {"file": "a.toml"}
        (row,) = next(iter(files_view(VerifiedFiles((document,))).blocks())).rows
        overshoot = row[4].number  # the record of a board that grows has none
        assert (overshoot is None) is verdict.poles.known_unstable
        assert next(c["band"] for c in document["checks"] if c["name"] == "settling_time") == 0.025
        files = VerifiedFiles((document | {"checks": [plain(lost)]},))
        text = files_junit(files)
        assert f">fail: - {BAND}, limit 1 ns; outside after 1 ns, the limit<" in text


@pytest.mark.parametrize("name", STUDIES)
def test_columns_and_axes_of_studies(name: str) -> None:
    titles = []
    for block in page(name).blocks():
        if isinstance(block, Table):
            titles += block.columns
        elif isinstance(block, Chart):
            titles += [block.title, block.y.title, block.x.title]
    for title in titles:
        if re.match(r"settl(ing|es)( time)?\b", title, re.IGNORECASE):
            assert re.search(r"to ±[\d.]+ %$", title), title


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
