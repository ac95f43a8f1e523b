"""Files appear whole or not at all."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from spice_models.errors import InputError
from verification.report.atomic_files import check_folder, write_atomically

# A limit on the size of files is the kernel's own "no space": the write fails half way.
FULL = """
import resource, signal, sys
from spice_models.errors import InputError
from verification.report.atomic_files import write_atomically
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    write_atomically(sys.argv[1], "x" * 20_000)
except InputError as error:
    print(error)
"""


def test_a_disk_that_is_full_leaves_the_old_file_whole(tmp_path: Path) -> None:
    file = tmp_path / "baseline.json"
    file.write_text("old")
    run = subprocess.run(
        [sys.executable, "-c", FULL, str(file)], capture_output=True, text=True, check=True
    )
    assert str(file) in run.stdout
    assert "File too large" in run.stdout
    assert file.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["baseline.json"]


def test_a_new_file_has_the_permissions_of_any_other_and_an_old_one_keeps_its_own(
    tmp_path: Path,
) -> None:
    (tmp_path / "plain").write_text("")
    write_atomically(tmp_path / "new", "µ")
    assert (tmp_path / "new").read_text(encoding="utf-8") == "µ"
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    write_atomically(tmp_path / "new", "again")
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_a_device_is_written_to_and_not_replaced() -> None:
    write_atomically(os.devnull, "text")
    assert not Path(os.devnull).is_file()
    with pytest.raises(InputError, match="No space left on device"):
        write_atomically("/dev/full", "text")


@pytest.mark.parametrize(("name", "word"), [("missing/x.json", "does not exist"), (".", "folder")])
def test_a_place_that_cannot_be_written_is_named_beforehand(
    tmp_path: Path, name: str, word: str
) -> None:
    with pytest.raises(InputError, match=word):
        check_folder(tmp_path / name, "--junit")
