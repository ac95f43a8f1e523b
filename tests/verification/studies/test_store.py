"""The store: transactions, concurrent writers, damage, wrong versions, full and read-only disks."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from taction.system.errors import InputError, OutOfDisk
from taction.verification.studies import store as module
from taction.verification.studies.store import ERROR, FORMAT, Store, StoredResult
from tests.support.paths import ROOT


def key(number: int) -> bytes:
    return number.to_bytes(32, "big")


def record(number: int) -> dict[str, Any]:
    return {"value": number / 7}


def put(store: Store, number: int, request: bytes, outcome: str = "pass") -> None:
    store.put(key(number), StoredResult(outcome, record(number)), request)


def test_a_result_comes_back_as_it_was(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1, b"asked")
        assert store.record_of(b"asked") == record(1)
        assert store.record_of(b"never asked") is None
        assert store.key_of(b"asked") == key(1)
        assert store.outcome_of(key(1)) == "pass"
    with Store(str(tmp_path / "a.sqlite")) as store:
        assert store.count() == 1
        assert store.record_of(b"asked") == record(1)


def test_the_file_is_one_file_when_nothing_runs(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1, b"asked")
    assert [file.name for file in tmp_path.iterdir()] == ["a.sqlite"]
    (tmp_path / "copy.sqlite").write_bytes((tmp_path / "a.sqlite").read_bytes())
    with Store(str(tmp_path / "copy.sqlite")) as copy:
        assert copy.record_of(b"asked") == record(1)


def test_only_an_error_is_replaced(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1, b"asked", ERROR)
        put(store, 1, b"asked", "fail")
        put(store, 1, b"asked", "pass")
        assert store.outcome_of(key(1)) == "fail"


def test_two_requests_may_come_down_to_one_point(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1, b"lambda")
        store.link(b"resistance", key(1))
        assert store.record_of(b"resistance") == record(1)
        assert store.count() == 1


def test_waveforms_are_kept_beside_the_record(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        store.put(b"k", StoredResult("pass", {}, b"data"), b"asked")
        put(store, 2, b"other")
        assert store.waveforms(b"k") == b"data"
        assert store.has_waveforms(b"k")
        assert not store.has_waveforms(key(2))


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
            put(store, number, key(number))
    spoil(path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=says) as caught:
        Store(str(path))
    assert str(path) in str(caught.value)
    assert path.read_bytes() == before


def _flip(path: Path, table: str, column: str, byte: int) -> None:
    """Change one byte of a stored value."""
    with sqlite3.connect(path) as db:
        rows = db.execute(f"select key, cast({column} as blob) from {table}").fetchall()  # noqa: S608
        for name, content in rows:
            data = bytearray(content)
            data[byte % len(data)] ^= 0x11
            query = f"update {table} set {column} = ? where key = ?"  # noqa: S608
            db.execute(query, (bytes(data), name))
    db.close()


@pytest.mark.parametrize("column", ["outcome", "record", "seal"])
@pytest.mark.parametrize("byte", [0, 3, -2])
def test_a_damaged_row_is_not_stored_and_can_be_replaced(
    tmp_path: Path, column: str, byte: int
) -> None:
    path = tmp_path / "a.sqlite"
    with Store(str(path)) as store:
        put(store, 1, b"asked")
    _flip(path, "points", column, byte)
    with Store(str(path)) as store:
        assert store.record_of(b"asked") is None
        assert store.outcome_of(key(1)) is None
        assert store.damaged == {key(1)}
        put(store, 1, b"asked")
        assert store.record_of(b"asked") == record(1)
        assert not store.damaged


def test_damaged_waveforms_are_not_stored(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with Store(str(path)) as store:
        store.put(b"k", StoredResult("pass", {}, b"data"), b"asked")
    _flip(path, "waveforms", "data", 1)
    with Store(str(path)) as store:
        assert not store.has_waveforms(b"k")
        store.put(b"k", StoredResult("pass", {}, b"data"), b"asked")
        assert store.waveforms(b"k") == b"data"


def test_a_request_without_a_usable_key_is_not_stored(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with Store(str(path)) as store:
        put(store, 1, b"asked")
    with sqlite3.connect(path) as db:
        db.execute("update requests set key = 'text'")
    db.close()
    with Store(str(path)) as store:
        assert store.record_of(b"asked") is None


def test_a_pipe_is_no_database(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.sqlite")
    with pytest.raises(InputError, match="not a regular file"):
        Store(str(tmp_path / "a.sqlite"))


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        Store(str(tmp_path / "missing" / "a.sqlite"))


def test_a_full_disk_loses_nothing(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 0, b"first")
        pages = store._db.execute("pragma page_count").fetchone()[0]
        store._db.execute(f"pragma max_page_count = {pages}")
        with pytest.raises(OutOfDisk, match="run the same command again"):
            store.put(b"k", StoredResult("pass", {"text": "x" * 100_000}), b"second")
        assert store.record_of(b"first") == record(0)
    with Store(str(tmp_path / "a.sqlite")) as store:
        store.put(b"k", StoredResult("pass", {"text": "x" * 100_000}), b"second")
        assert store.count() == 2


def test_a_read_only_database(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 0, b"first")
        store._db.execute("pragma query_only = on")  # root may write to any file
        with pytest.raises(InputError, match="cannot be written"):
            put(store, 1, b"second")


def test_another_process_that_never_lets_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.05)
    with Store(str(tmp_path / "a.sqlite")) as store, Store(str(tmp_path / "a.sqlite")) as other:
        other._db.execute("begin immediate")
        with pytest.raises(InputError, match="another process"):
            put(store, 1, b"asked")
        other._db.execute("rollback")
        put(store, 1, b"asked")


WRITER = """
import sys
from taction.verification.studies.store import Store, StoredResult
with Store(sys.argv[1]) as store:
    for number in range(40):
        key = number.to_bytes(32, "big")
        store.put(key, StoredResult("pass", {"by": sys.argv[2]}), key)
"""


def test_two_processes_at_once(tmp_path: Path) -> None:
    path = str(tmp_path / "a.sqlite")
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, path, name], cwd=ROOT) for name in "ab"
    ]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    with Store(path) as store:
        assert store.count() == 40
        rows = [store.record_of(key(number)) for number in range(40)]
    assert {row["by"] for row in rows if row is not None} <= {"a", "b"}
    assert None not in rows


def test_a_damaged_name_that_is_no_text_is_reported_as_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with Store(str(path)) as store:
        put(store, 1, b"asked")
    content = path.read_bytes()
    path.write_bytes(content.replace(b"TABLE points", b"TABLE p\xf1ints"))
    with pytest.raises(InputError, match="the database is damaged"):
        Store(str(path))
