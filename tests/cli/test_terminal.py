"""What stands in a terminal: progress on stderr, and tables of every width."""

from __future__ import annotations

from itertools import count, pairwise

import pytest

from taction.cli.printing import StageLine
from tests.support.command_lines import LINES
from tests.support.printed import printed_objects, shown_at, words_of


def test_lines_become_rare() -> None:
    said: list[str] = []
    seconds = count(0.0, 1.0)
    line = StageLine(say=said.append, clock=lambda: next(seconds))
    for number in range(1, 3601):
        line(str(number))
    assert said[:5] == ["10", "15", "23", "35", "53"]  # seconds, each 1.5 times the last
    assert len(said) == 20
    assert max(int(b) - int(a) for a, b in pairwise(said)) == 300


WIDTHS = (40, 80, 100)

# The variant of a command with the widest tables.
WIDE = {
    "verify": "verify a.toml --margins -v",
    "check": "check filter.cir --over Rf=1k:100k:5 --check stable --no-ngspice",
    "corners": "corners a.toml --corner capacitor=-1 --corner resistor=1",
    "sweep": "sweep a.toml --over C=1pF:10pF:2 --over opamp=ua741,op27 --jobs 1",
}
SAME = ("verify-files", "diff", "bom", "montecarlo", "regress", "models-show", "tune")
TABLES = {**{name: LINES[name] for name in SAME}, **WIDE}


@pytest.mark.usefixtures("boards")
@pytest.mark.parametrize("name", TABLES)
def test_a_narrow_page_loses_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = printed_objects(monkeypatch, *TABLES[name].split())
    wide = words_of(shown_at(200, objects))
    assert len(wide) > 10
    for width in WIDTHS:
        narrow = shown_at(width, objects)
        lost = wide - words_of(narrow)
        assert not lost, f"{width} columns:\n{narrow}"
        assert "…" not in narrow
