"""Files appear whole or not at all."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.system.output_files import ABANDONED, write_atomically

# A limit on the size of files is the kernel's own "no space": the write fails half way.
FULL = """
import resource, signal, sys
from taction.system.errors import InputError
from taction.system.output_files import write_atomically
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
        [sys.executable, "-B", "-c", FULL, str(file)], capture_output=True, text=True, check=True
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


def test_a_link_and_a_device_are_written_to_and_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    write_atomically(os.devnull, "text")
    assert not Path(os.devnull).is_file()
    with pytest.raises(InputError, match="No space left on device"):
        write_atomically("/dev/full", "text")


def test_text_that_is_no_unicode_is_escaped(tmp_path: Path) -> None:
    name = os.fsdecode(b"board-\xff.toml")
    write_atomically(tmp_path / "a.json", json.dumps({"µ": name}, ensure_ascii=False))
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"µ": name}
    write_atomically(tmp_path / name, b"content")
    assert (tmp_path / name).read_bytes() == b"content"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("missing/file", "its folder does not exist"),
        ("folder", "Is a directory; expected a file that can be written"),
        ("file/below", "Not a directory"),
        ("a\0b", "null (byte|character)"),  # by version of Python
        ("x" * 300, "File name too long"),
    ],
)
def test_a_name_that_cannot_be_written_is_an_input_error(
    name: str, reason: str, tmp_path: Path
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=reason) as refused:
        write_atomically(tmp_path / name, "text")
    assert refused.value.file == str(tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {"file", "folder"}


def test_a_later_writer_clears_what_a_killed_writer_left(tmp_path: Path) -> None:
    left, used, foreign = (tmp_path / f".taction-{name}.csv" for name in ("left", "used", "link"))
    left.write_text("half")
    used.write_text("half")
    foreign.symlink_to(tmp_path / "elsewhere")
    os.utime(left, times=(0.0, time.time() - 2.0 * ABANDONED))
    os.utime(foreign, times=(0.0, 0.0), follow_symlinks=False)
    write_atomically(tmp_path / "new", "text")
    assert {path.name for path in tmp_path.iterdir()} == {"new", used.name, foreign.name}
