"""Calls of a study in their order, digests of their content, and the store of results."""

from __future__ import annotations

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from taction.system.errors import InputError, Killed, OutOfDisk
from taction.verification.studies.running import store as module
from taction.verification.studies.running.store import FORMAT, Store
from taction.verification.studies.running.study import RUNS, attempted, for_each
from taction.verification.studies.running.versions import digest
from tests.support import nightly
from tests.support.making import write_matrix_scene
from tests.support.paths import ROOT
from tests.support.running import python
from tests.support.studying import IDEAL


def key(number: int) -> bytes:
    return number.to_bytes(32, "big")


@dataclass(frozen=True, slots=True)
class Row:
    outcome: str
    value: float
    text: str = ""


def put(store: Store, number: int, outcome: str = "pass") -> None:
    store.put(key(number), Row(outcome, number / 7))


def test_a_result_comes_back_as_it_was_and_only_an_error_is_replaced(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        put(store, 1)
        assert store.record_of(key(1), Row) == Row("pass", 1 / 7)
        assert store.record_of(key(2), Row) is None
        assert (store.outcome_of(key(1)), store.count()) == ("pass", 1)
    assert [file.name for file in tmp_path.iterdir()] == ["a.sqlite"]
    (tmp_path / "copy.sqlite").write_bytes((tmp_path / "a.sqlite").read_bytes())
    with Store(str(tmp_path / "copy.sqlite")) as copy:
        assert copy.record_of(key(1), Row) == Row("pass", 1 / 7)
    with Store(str(tmp_path / "a.sqlite")) as store:
        for outcome in ("error", "fail", "pass"):
            put(store, 3, outcome)
        assert store.outcome_of(key(3)) == "fail"


def executed(statement: str, *values: str) -> Callable[[Path], None]:
    """Return what gives a database, or a new one, a statement."""

    def spoil(path: Path) -> None:
        with closing(sqlite3.connect(path)) as db, db:
            db.execute(statement, values)

    return spoil


def other_program(path: Path) -> None:
    path.unlink()
    executed("create table cats (name)")(path)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda path: path.write_text("a,b\n" * 2000), "no SQLite database"),
        (lambda path: path.write_bytes(path.read_bytes()[:5000]), "damaged"),
        (lambda path: path.write_bytes(path.read_bytes()[:4096] + os.urandom(9000)), "damaged"),
        (other_program, "another program"),
        (
            executed(f"pragma user_version = {FORMAT + 1}"),
            f"results of format {FORMAT + 1}, this taction has {FORMAT}",
        ),
    ],
)
def test_a_spoilt_database_stays(tmp_path: Path, spoil: Callable[[Path], None], says: str) -> None:
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
        executed("update points set record = ?", text)(path)
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


def test_a_process_that_never_lets_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def killed_at_b(name: str) -> str:
    if name == "b":
        os.kill(os.getpid(), signal.SIGKILL)
    return name.upper()


def missing(error: BaseException | None, reason: str, name: str) -> str:
    return f"{name}: {reason}"


def test_a_killed_process_costs_only_its_own_call() -> None:
    calls = [(name,) for name in "abcd"]
    first, second, *others = for_each(killed_at_b, calls, "abcd", missing, jobs=2)
    assert (first, others) == ("A", ["C", "D"])
    assert second.startswith("b: its process was killed several times")


def test_ctrl_c_leaves_what_did_not_run() -> None:
    def interrupted(name: str) -> str:
        if name == "c":
            raise KeyboardInterrupt
        return name

    found = for_each(interrupted, [(name,) for name in "abcd"], "abcd", missing, jobs=1)
    assert found == ["a", "b", "c: ", "d: "]


@pytest.mark.parametrize(("kills", "found"), [(RUNS - 1, "result"), (10, "a signal ended")])
def test_a_killed_run_is_repeated_and_the_last_kept(tmp_path: Path, kills: int, found: str) -> None:
    runs: list[Path] = []

    def compute() -> str:
        runs.append(tmp_path / str(len(runs)))
        runs[-1].mkdir()
        if len(runs) <= kills:
            raise Killed("a signal ended ngspice", folder=runs[-1])
        return "result"

    assert attempted(compute, lambda error, text: text).startswith(found)
    assert [run.exists() for run in runs] == [False] * (RUNS - 1) + [True]


def test_types_and_borders_count() -> None:
    values: list[tuple[object, ...]] = [(each,) for each in (1, 1.0, "1", True, b"1", None)]
    values += [(0.0,), (-0.0,), ("ab", "c"), ("a", "bc"), (("a", "b"), "c"), ("a", ("b", "c"))]
    arrays = [[1.0, 2.0], [1.0, np.nextafter(2.0, 3.0)], [[1.0, 2.0]]]
    values += [(np.array(each),) for each in arrays]
    values += [(np.array([1.0, 2.0], dtype=np.float32),)]
    assert len({digest(*value) for value in values}) == len(values) == 16


def command(folder: Path, *more: str) -> list[str]:
    words = ["-m", "taction", "sweep", str(folder / "scene.toml"), "--over", "C=50p:500p:40"]
    words += ["--engine", "statespace", "--jobs", "1", "-o", str(folder / "a.sqlite")]
    return [*words, *more]


def stored(path: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=10)) as db:
            return int(db.execute("select count(*) from points").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


@pytest.mark.parametrize(
    ("number", "status", "says"),
    [
        (signal.SIGINT, 130, "the same command continues"),
        *nightly((signal.SIGKILL, -9, "")),  # `tests/torture` has a kill with every commit
    ],
)
def test_a_sweep_that_is_ended_goes_on_where_it_was(
    number: signal.Signals, status: int, says: str, tmp_path: Path
) -> None:
    write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], IDEAL)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    words = [sys.executable, *command(tmp_path)]
    process = subprocess.Popen(words, cwd=ROOT, text=True, start_new_session=True, **pipes)
    while stored(tmp_path / "a.sqlite") < 5:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(number)
    try:
        _, text = process.communicate(timeout=120)
    finally:
        process.kill()
    before = stored(tmp_path / "a.sqlite")
    assert process.returncode == status, text
    assert says in text
    assert "Traceback" not in text
    assert 5 <= before < 40
    done = python(*command(tmp_path, "--json"))
    assert done.returncode == 0, done.stderr
    said, *later = done.stderr.splitlines()
    assert re.fullmatch(r"taction: computing \d+ of 40 points", said)
    assert [line for line in later if " of 40 points" not in line] == []  # on a slow machine
    document = json.loads(done.stdout)
    assert document["ran"] == 40 - before
    assert len(document["points"]) == document["done"] == 40
    assert all(point["outcome"] == "pass" for point in document["points"])
