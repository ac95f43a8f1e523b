"""Scenes and files for the commands; every test has its own copy, and stands in its folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.designer_decks import DECKS
from tests.support.entries import write_fast

TOLERANCES = "[tolerances]\nresistor = 0.01\n"


@pytest.fixture
def boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene that passes, one that fails, one that is no scene; a baseline, a matrix, a deck."""
    write_fast(tmp_path / "a.toml", more=TOLERANCES)
    write_fast(tmp_path / "slow.toml", limit="1us", capacitance="20pF")
    (tmp_path / "bad.toml").write_text("[problem]\nkind = 'tactil'\n")
    (tmp_path / "b.json").write_text('{"taction_baseline": 6, "scenes": {}}')
    (tmp_path / "T.csv").write_text("2.0,0.5\n0.5,1.0\n")
    (tmp_path / "eps.csv").write_text("1.0\n0.5\n")
    (tmp_path / "filter.cir").write_text(DECKS["sallen-key-gain"])
    monkeypatch.chdir(tmp_path)
    return tmp_path
