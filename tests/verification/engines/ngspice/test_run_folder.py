"""Run folders: made, filled and removed."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from taction.system.errors import InputError, OutOfDisk
from taction.system.own_folders import remove_own_folder
from taction.verification.engines.ngspice.process import make_folder
from tests.support.small_decks import transient


def test_a_run_has_all_that_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    place = make_folder(transient(files={"a.inc": "* x\n"}), "ngspice\n", None)
    assert place.parent == tmp_path
    texts = {path.name: path.read_text() for path in place.iterdir()}
    assert texts.pop("spinit").startswith("*")
    expected = {"a.inc": "* x\n", "command.txt": "ngspice\n", "deck.cir": transient().text}
    assert texts == expected
    assert place.stat().st_mode & 0o077 == 0
    remove_own_folder(place)
    assert not list(tmp_path.iterdir())


def test_a_folder_within_is_removed_too(tmp_path: Path) -> None:
    (tmp_path / "run" / "within").mkdir(parents=True)
    (tmp_path / "run" / "within" / "file").touch()
    remove_own_folder(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_given_folder_is_made_and_must_be_empty(tmp_path: Path) -> None:
    place = make_folder(transient(), "", tmp_path / "a" / "b")
    assert place == tmp_path / "a" / "b"
    with pytest.raises(InputError, match="must be empty"):
        make_folder(transient(), "", place)
    with pytest.raises(OutOfDisk, match="cannot be made"):
        make_folder(transient(), "", place / "deck.cir" / "c")
