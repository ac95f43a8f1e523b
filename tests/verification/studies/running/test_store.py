"""The store: transactions, concurrent writers, damage, wrong versions, full and read-only disks."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from taction.system.errors import InputError, OutOfDisk
from taction.verification.studies.running import store as module
from taction.verification.studies.running.store import FORMAT, Store
from tests.support.paths import ROOT


def key(number: int) -> bytes:
    return number.to_bytes(32, "big")


@dataclass(frozen=True, slots=True)
class Row:
    outcome: str
    value: float
    text: str = ""


def put(store: Store, number: int, outcome: str = "pass") -> None:
    store.put(key(number), Row(outcome, number / 7))


def test_a_result_comes_back_as_it_was(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1)
        assert store.record_of(key(1), Row) == Row("pass", 1 / 7)
        assert store.record_of(key(2), Row) is None
        assert store.outcome_of(key(1)) == "pass"
    with Store(str(tmp_path / "a.sqlite")) as store:
        assert store.count() == 1
        assert store.record_of(key(1), Row) == Row("pass", 1 / 7)


def test_the_file_is_one_file_when_nothing_runs(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1)
    assert [file.name for file in tmp_path.iterdir()] == ["a.sqlite"]
    (tmp_path / "copy.sqlite").write_bytes((tmp_path / "a.sqlite").read_bytes())
    with Store(str(tmp_path / "copy.sqlite")) as copy:
        assert copy.record_of(key(1), Row) == Row("pass", 1 / 7)


def test_only_an_error_is_replaced(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1, "error")
        put(store, 1, "fail")
        put(store, 1, "pass")
        assert store.outcome_of(key(1)) == "fail"


def _truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:5000])


def _garble(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:8192] = os.urandom(4096)
    path.write_bytes(data)


def _other_program(path: Path) -> None:
    path.unlink()
    with sqlite3.connect(path) as db:
        db.execute("create table cats (name)")
    db.close()


def _other_format(path: Path) -> None:
    with sqlite3.connect(path) as db:
        db.execute(f"pragma user_version = {FORMAT + 1}")
    db.close()


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda path: path.write_text("a,b\n" * 2000), "no SQLite database"),
        (_truncate, "damaged"),
        (_garble, "damaged"),
        (_other_program, "another program"),
        (_other_format, f"results of format {FORMAT + 1}, this taction has {FORMAT}"),
    ],
)
def test_a_spoilt_database_is_named_and_left_alone(
    tmp_path: Path, spoil: Callable[[Path], None], says: str
) -> None:
    path = tmp_path / "a.sqlite"
    with Store(str(path)) as store:
        for number in range(50):
            put(store, number)
    spoil(path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=says) as caught:
        Store(str(path))
    assert str(path) in str(caught.value)
    assert path.read_bytes() == before


def test_a_record_that_is_none_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with Store(str(path)) as store:
        put(store, 1)
    for text in ("{", "[]", '{"outcome": 3}'):
        with sqlite3.connect(path) as db:
            db.execute("update points set record = ?", (text,))
        db.close()
        with Store(str(path)) as store, pytest.raises(InputError, match="the database is damaged"):
            store.record_of(key(1), Row)


def test_a_full_disk_loses_nothing(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 0)
        pages = store._db.execute("pragma page_count").fetchone()[0]
        store._db.execute(f"pragma max_page_count = {pages}")
        with pytest.raises(OutOfDisk, match="run the same command again"):
            store.put(b"k", Row("pass", 0.0, "x" * 100_000))
        assert store.record_of(key(0), Row) == Row("pass", 0.0)
    with Store(str(tmp_path / "a.sqlite")) as store:
        store.put(b"k", Row("pass", 0.0, "x" * 100_000))
        assert store.count() == 2


def test_another_process_that_never_lets_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.05)
    with Store(str(tmp_path / "a.sqlite")) as store, Store(str(tmp_path / "a.sqlite")) as other:
        other._db.execute("begin immediate")
        with pytest.raises(InputError, match="another process"):
            put(store, 1)
        other._db.execute("rollback")
        put(store, 1)


WRITER = """
import sys
from taction.verification.studies.running.store import Store
from taction.verification.verdict.record import Record
with Store(sys.argv[1]) as store:
    for number in range(40):
        store.put(number.to_bytes(32, "big"), Record("pass", sys.argv[2]))
"""


def test_two_processes_at_once(tmp_path: Path) -> None:
    path = str(tmp_path / "a.sqlite")
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, path, name], cwd=ROOT) for name in "ab"
    ]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    with Store(path) as store:
        assert store.count() == 40
        rows = [store.record_of(key(number), dict) for number in range(40)]
    assert {row["engine"] for row in rows if row is not None} <= {"a", "b"}
    assert None not in rows
