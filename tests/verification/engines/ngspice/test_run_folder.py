"""Run folders on disk, and those of sessions in memory where that is safe."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from spice_models.errors import InputError, OutOfDisk
from tests.support.small_decks import transient
from verification.engines.ngspice import run_folder
from verification.engines.ngspice.run_folder import fast_folder, make_folder, remove_folder


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that stands for the file system in memory, and another one for the disk."""
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.delenv(name, raising=False)
    for name in ("memory", "disk"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "disk"))
    monkeypatch.setattr(run_folder, "MEMORY", tmp_path / "memory")
    monkeypatch.setattr(run_folder, "LEAST_FREE", 1)
    return tmp_path / "memory"


def test_a_run_is_on_disk_with_all_that_it_needs(memory: Path) -> None:
    place = make_folder(transient(files={"a.inc": "* x\n"}), "ngspice\n", None)
    assert place.parent == memory.parent / "disk"
    texts = {path.name: path.read_text() for path in place.iterdir()}
    assert texts.pop("spinit").startswith("*")
    expected = {"a.inc": "* x\n", "command.txt": "ngspice\n", "deck.cir": transient().text}
    assert texts == expected
    assert place.stat().st_mode & 0o077 == 0
    remove_folder(place)
    assert not list((memory.parent / "disk").iterdir())


def test_memory_is_for_what_fits_and_is_not_wanted_elsewhere(
    memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(size: float = 1e6) -> str:
        return fast_folder(size).parent.name

    assert made() == "memory"
    assert made(1e18) == "disk"
    monkeypatch.setenv("TMPDIR", str(memory.parent / "disk"))
    assert made() == "disk"
    monkeypatch.delenv("TMPDIR")
    monkeypatch.setattr(run_folder, "LEAST_FREE", 1 << 80)
    assert made() == "disk"
    monkeypatch.setattr(run_folder, "LEAST_FREE", 1)
    monkeypatch.setattr(run_folder, "MEMORY", memory / "nowhere")
    assert made() == "disk"


def test_a_folder_within_is_removed_too(tmp_path: Path) -> None:
    (tmp_path / "run" / "within").mkdir(parents=True)
    (tmp_path / "run" / "within" / "file").touch()
    remove_folder(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_given_folder_is_made_and_must_be_empty(tmp_path: Path) -> None:
    place = make_folder(transient(), "", tmp_path / "a" / "b")
    assert place == tmp_path / "a" / "b"
    with pytest.raises(InputError, match="must be empty"):
        make_folder(transient(), "", place)
    with pytest.raises(OutOfDisk, match="cannot be written"):
        make_folder(transient(), "", place / "deck.cir" / "c")
