"""No text of a picture lies over another one or is cut off, for all kinds of boards and studies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import taction
from taction.verification.report.renderers.picture import draw_page, draw_sheet
from taction.verification.report.views import accuracy, montecarlo, onset, sweep, tune
from taction.verification.report.views.verdict import view
from tests.support.making import make_scene
from tests.support.report_pages import (
    STATESPACE,
    VERDICTS,
    swept,
    tuned,
    varied,
    verdicts,
    work_precision,
)
from tests.support.text_boxes import cut_off, figures, overlapping


def _sweep(*over: str) -> Callable[[str], None]:
    def draw(path: str) -> None:
        result = swept(*over)
        with result.store:
            draw_page(sweep.view(result), path)

    return draw


def _onset(path: str) -> None:
    scene = make_scene({"channels": 3, "span": 2.0}, analysis=STATESPACE)
    draw_page(onset.view(taction.onset(scene, over="C=1pF:100pF:13", transients=False)), path)


def _yield(path: str) -> None:
    scene, result, samples = varied()
    draw_sheet(montecarlo.sheet(scene.name, result, samples), path)


STUDIES: dict[str, Callable[[str], None]] = {
    "sweep, a map": _sweep("C=10pF:100pF:4", "gain=10k:100k:3"),
    "sweep, a curve": _sweep("C=10pF:100pF:8"),
    "sweep, op-amps": _sweep("opamp.base=ua741,op27", "C=10pF:100pF:3"),
    "sweep, only op-amps": _sweep("opamp.base=ua741,op27,tl084"),
    "sweep, three axes": _sweep("C=10pF:100pF:3", "gain=10k:100k:2", "stray_capacitance=1p:9p:3"),
    "onset": _onset,
    "montecarlo": _yield,
    "tune": lambda path: draw_sheet(tune.sheet(tuned()[0]), path),
    "accuracy": lambda path: draw_page(accuracy.view(work_precision()), path),
}


@pytest.mark.parametrize("name", VERDICTS)
def test_the_texts_of_a_verdict_are_readable(name: str, tmp_path: Path) -> None:
    with figures() as saved:
        draw_page(view(verdicts()[name]), str(tmp_path / "picture.png"))
    (figure,) = saved
    assert overlapping(figure) == []
    assert cut_off(figure) == []


@pytest.mark.parametrize("name", STUDIES)
def test_the_texts_of_a_study_are_readable(name: str, tmp_path: Path) -> None:
    with figures() as saved:
        STUDIES[name](str(tmp_path / "picture.png"))
    (figure,) = saved
    assert overlapping(figure) == []
    assert cut_off(figure) == []
