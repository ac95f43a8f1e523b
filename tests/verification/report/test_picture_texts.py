"""No text of a picture lies over another one or is cut off, for all kinds of boards and studies."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.verification.report.renderers.picture import draw_page
from tests.support.report_pages import STUDIES, VERDICTS, page
from tests.support.text_boxes import cut_off, figures, overlapping, texts_of

WITHOUT = {"corners", "regress", "choose, none passes"}


@pytest.mark.parametrize("name", [*VERDICTS, *sorted(STUDIES.keys() - WITHOUT)])
def test_the_texts_of_a_picture_are_readable(name: str, tmp_path: Path) -> None:
    with figures() as saved:
        draw_page(page(name), str(tmp_path / "picture.png"))
    (figure,) = saved
    texts = texts_of(figure)
    assert texts
    assert overlapping(texts) == []
    assert cut_off(figure, texts) == []
