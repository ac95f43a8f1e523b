"""Files appear whole or not at all; temporary folders are cleared, also after a kill."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from taction.system import processes
from taction.system.errors import InputError
from taction.system.foreign_files import UnusableFileError, read_bounded, read_ends, visible
from taction.system.output_files import ABANDONED, write_atomically
from taction.system.processes import clear_abandoned, make_own_folder, own_folder
from tests.support.running import is_running


def test_a_new_file_has_the_usual_permissions_and_an_old_one_keeps_its_own(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    write_atomically(tmp_path / "new", "µ")
    assert (tmp_path / "new").read_text(encoding="utf-8") == "µ"
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    write_atomically(tmp_path / "new", "again")
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640


def test_a_link_and_a_pipe_are_written_to_and_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")  # no device of the machine: wrong code would replace it
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(tmp_path / "pipe", "text")
    assert os.read(reader, 9) == b"text"


def test_text_that_is_no_unicode_is_escaped(tmp_path: Path) -> None:
    name = os.fsdecode(b"board-\xff.toml")
    write_atomically(tmp_path / "a.json", json.dumps({"µ": name}, ensure_ascii=False))
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"µ": name}
    write_atomically(tmp_path / name, "content")
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
def test_a_name_that_cannot_be_written_is_bad_input(name: str, reason: str, tmp_path: Path) -> None:
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


def test_a_file_comes_back_whole_or_is_refused(tmp_path: Path) -> None:
    """One over the limit is refused without being read: this one is sparse."""
    file = tmp_path / "a"
    file.write_bytes(bytes(range(256)) * 8000)  # more than one piece
    assert read_bounded(file, 3_000_000) == file.read_bytes()
    assert read_bounded(file, 256 * 8000) == file.read_bytes()
    assert read_ends(file, 3_000_000) == file.read_bytes().decode(errors="replace")
    with file.open("wb") as stream:
        stream.truncate(10**12)
    with pytest.raises(UnusableFileError, match=re.escape("over 2 MB, the largest size")):
        read_bounded(file, 2_000_000)
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", tmp_path, "/dev/zero", "/dev/null"):
        with pytest.raises(UnusableFileError, match="not a regular file"):
            read_bounded(name, 1000)
    for name, says in ((tmp_path / "missing", "No such file"), ("a\0b", "embedded null")):
        with pytest.raises(UnusableFileError, match=says):
            read_ends(name, 1000)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain µ Ω", "plain µ Ω"),
        ("a\r\tb", r"a\r\tb"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("\u202eevil\u2028", r"\u202eevil\u2028"),
        ("\udcff", r"\udcff"),
        ("::error::x", r"\x3a:error::x"),
        ("  ::error::x", r"  \x3a:error::x"),
        ("a\n::error::x", r"a\n::error::x"),
        ("a::b", "a::b"),
        ("##[error]x", r"\x23#[error]x"),
        ("# [x]", "# [x]"),
    ],
)
def test_a_text_is_shown_in_one_printable_line(text: str, shown: str) -> None:
    assert visible(text) == shown
    assert visible(text).isprintable()


OWNER = """
import sys, time
from taction.system.processes import make_own_folder
print(make_own_folder(), flush=True)
time.sleep(600)
"""


def owner(place: Path) -> tuple[subprocess.Popen[str], Path]:
    words, env = [sys.executable, "-c", OWNER], {**os.environ, "TMPDIR": str(place)}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=env)
    assert process.stdout is not None
    return process, Path(process.stdout.readline().rstrip("\n"))


def test_a_folder_stays_while_its_process_lives_and_goes_after_a_kill(tmp_path: Path) -> None:
    process, folder = owner(tmp_path)
    try:
        (folder / "file").write_text("half")
        clear_abandoned(tmp_path)
        assert folder.is_dir()
    finally:
        process.kill()
        process.communicate()
    clear_abandoned(tmp_path)
    assert not list(tmp_path.iterdir())


def test_what_is_not_ours_stays(tmp_path: Path) -> None:
    place, elsewhere = tmp_path / "place", tmp_path / "elsewhere"
    foreign, others = place / "taction-run-foreign", ("pymp-other", "taction-kept-told")
    for folder in (place, elsewhere, foreign, *(place / name for name in others)):
        folder.mkdir()
    (place / "taction-run-link").symlink_to(elsewhere)
    (place / "taction-run-file").touch()
    if os.geteuid() == 0:
        os.chown(foreign, 65534, 65534)
    clear_abandoned(place)
    left = {path.name for path in place.iterdir()}
    names = {"taction-run-link", "taction-run-file", *others}
    assert left == (names | {foreign.name} if os.geteuid() == 0 else names)
    assert elsewhere.is_dir()
    with own_folder() as folder:  # what is ours goes with all that is in it
        (folder / "within").mkdir()
        (folder / "within" / "file").touch()
    assert not folder.exists()


def test_a_folder_that_another_process_clears_before_the_lock_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    make = processes.tempfile.mkdtemp

    def cleared(**where: str) -> str:
        made.append(make(**where))
        if len(made) == 1:
            Path(made[0]).rmdir()
        return made[-1]

    monkeypatch.setattr(processes.tempfile, "mkdtemp", cleared)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert str(make_own_folder()) == made[1] != made[0]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_processes_of_an_abandoned_folder_are_ended_and_no_others(tmp_path: Path) -> None:
    process, folder = owner(tmp_path)
    inside, outside = (
        subprocess.Popen(
            ["sleep", "600"], env={"PATH": os.environ["PATH"], "HOME": home}, start_new_session=True
        )
        for home in (f"{folder}/run", f"{folder}-other")
    )
    try:
        process.kill()
        process.communicate()
        clear_abandoned(tmp_path)
        assert inside.wait(60) == -signal.SIGKILL
        time.sleep(0.1)
        assert outside.poll() is None
        assert is_running(outside.pid)
    finally:
        for each in (process, inside, outside):
            each.kill()
            each.wait()
    assert not folder.exists()
