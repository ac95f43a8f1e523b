"""Run folders: in memory where that is safe, on disk where they stay."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from small_decks import SmallDeck, endless, transient

from spice_models.errors import DidNotLoad, InputError, OutOfDisk
from verification.engines import runfolder
from verification.engines.ngspice import find_simulator, simulate, start
from verification.engines.runfolder import fresh_folder, keep_folder, make_folder, remove_folder


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that stands for the file system in memory, and another one for the disk."""
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.delenv(name, raising=False)
    for name in ("memory", "disk"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "disk"))
    monkeypatch.setattr(runfolder, "MEMORY", tmp_path / "memory")
    monkeypatch.setattr(runfolder, "LEAST_FREE", 1)
    return tmp_path / "memory"


def made(deck: SmallDeck, *, keep: bool = False) -> str:
    """Where a folder for `deck` is made."""
    return make_folder(deck, "", None, keep=keep).parent.name


def test_a_run_that_leaves_nothing_is_in_memory(memory: Path) -> None:
    place = make_folder(transient(files={"a.inc": "* x\n"}), "ngspice\n", None, keep=False)
    assert place.parent == memory
    texts = {path.name: path.read_text() for path in place.iterdir()}
    assert texts.pop("spinit").startswith("*")
    expected = {"a.inc": "* x\n", "command.txt": "ngspice\n", "deck.cir": transient().text}
    assert texts == expected
    assert place.stat().st_mode & 0o077 == 0
    remove_folder(place)
    assert not list(memory.iterdir())


def test_what_stays_or_may_not_fit_or_is_wanted_elsewhere_is_on_disk(
    memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert made(transient()) == "memory"
    assert made(transient(), keep=True) == "disk"
    assert made(endless()) == "disk"  # 160 GB
    assert fresh_folder(1e18).parent.name == "disk"
    monkeypatch.setenv("TMPDIR", str(memory.parent / "disk"))
    assert made(transient()) == "disk"
    monkeypatch.delenv("TMPDIR")
    monkeypatch.setattr(runfolder, "LEAST_FREE", 1 << 80)
    assert made(transient()) == "disk"
    monkeypatch.setattr(runfolder, "LEAST_FREE", 1)
    monkeypatch.setattr(runfolder, "MEMORY", memory / "nowhere")
    assert made(transient()) == "disk"


def test_a_reproducer_is_kept_on_disk(memory: Path, ngspice: str) -> None:
    with pytest.raises(DidNotLoad) as caught:
        simulate(transient("D1 out 0 nowhere"), find_simulator(ngspice), timeout=30.0)
    folder = caught.value.folder
    assert folder is not None
    assert folder.parent == memory.parent / "disk"
    assert str(folder) in str(caught.value)
    left = {path.name for path in folder.iterdir()}
    assert left >= {"deck.cir", "spinit", "command.txt", "stdout.txt", "stderr.txt"}
    assert "nowhere" in (folder / "stderr.txt").read_text()
    assert not list(memory.iterdir())


def test_a_cancelled_run_leaves_nothing_in_memory(memory: Path, ngspice: str) -> None:
    with start(transient(stop=1e-2), find_simulator(ngspice), timeout=30.0) as run:
        assert run.folder.parent == memory
    assert not list(memory.iterdir())


def test_a_reproducer_stays_in_memory_where_the_disk_is_full(
    memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = fresh_folder()
    (place / "out.raw").symlink_to("/dev/full")
    monkeypatch.setattr(tempfile, "tempdir", str(memory.parent / "gone"))
    assert keep_folder(place) == place
    assert (place / "out.raw").is_symlink()
    monkeypatch.setattr(tempfile, "tempdir", str(memory.parent / "disk"))
    kept = keep_folder(place)
    assert kept.parent.name == "disk"
    assert (kept / "out.raw").readlink() == Path("/dev/full")
    assert keep_folder(kept) == kept


def test_a_folder_within_is_removed_too(tmp_path: Path) -> None:
    (tmp_path / "run" / "within").mkdir(parents=True)
    (tmp_path / "run" / "within" / "file").touch()
    remove_folder(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_given_folder_is_made_and_must_be_empty(tmp_path: Path) -> None:
    place = make_folder(transient(), "", tmp_path / "a" / "b", keep=False)
    assert place == tmp_path / "a" / "b"
    with pytest.raises(InputError, match="must be empty"):
        make_folder(transient(), "", place, keep=False)
    with pytest.raises(OutOfDisk, match="cannot be written"):
        make_folder(transient(), "", place / "deck.cir" / "c", keep=False)
