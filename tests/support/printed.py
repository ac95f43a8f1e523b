"""What a command prints, on pages of several widths."""

from __future__ import annotations

import io
from collections import Counter
from typing import Any

import pytest
from rich.console import Console

from taction.verification.report.renderers.terminal import Terminal
from tests.support.running import taction

RULE = "─"


def printed_objects(monkeypatch: pytest.MonkeyPatch, *words: str) -> list[Any]:
    """Run a command once, and return what it printed on its pages."""
    found: list[Any] = []

    def keep(page: Terminal, *objects: Any, **options: Any) -> None:
        found.extend(objects)

    with monkeypatch.context() as patch:
        patch.setattr(Terminal, "print", keep)
        result = taction(*words)
    assert found, result.stderr
    return found


def shown_at(width: int, objects: list[Any], *, terminal: bool = False) -> str:
    """Return the text of `objects` on a page of `width` columns."""
    page = (
        Terminal(file=io.StringIO())
        if not terminal
        else Console(file=io.StringIO(), force_terminal=True, highlight=False, color_system=None)
    )
    page.width = width
    for each in objects:
        page.print(each)
    text = page.file
    assert isinstance(text, io.StringIO)
    return text.getvalue()


def words_of(text: str) -> Counter[str]:
    """Return how often each name and each number stands in a text, without the tables' rules."""
    return Counter(word for word in text.split() if RULE not in word)
