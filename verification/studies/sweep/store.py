"""Results of studies in one SQLite file, one transaction a point.

The file has a write-ahead log: killing the process loses no stored result, a power cut at most
those of the last moments and never the file, and a transaction takes 0.1 ms. A rollback journal
would wait for the disk at every point, 1.5 ms on an idle machine and 22 ms beside simulations that
write to the disk (measured). While a sweep runs, and after a kill, the log is the file FILE-wal;
the next process that opens the database merges the log.
"""

from __future__ import annotations

import json
import sqlite3
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spice_models.errors import Complaint, InputError, OutOfDisk

APPLICATION = 0x7461_6374  # "tact", in the file's header
FORMAT = 1  # of the results; a change in what a record means gets a new number
PATIENCE = 60.0  # s to wait for another process that has locked the file
ERROR = "error"  # outcome of a point that reached no verdict

SCHEMA = """
create table points (
    key blob primary key,       -- digest of circuit, problem, analysis, checks, engine, simulator
    outcome text not null,      -- pass, fail, inconclusive, error
    record text not null,       -- JSON, SI base units
    stored text not null default current_timestamp
) without rowid;
create table requests (
    request blob primary key,   -- digest of a scene with its changes
    key blob not null           -- the point with that circuit and analysis
) without rowid;
create table waveforms (
    key blob primary key,
    data blob not null          -- a compressed .npz: time (s), u (V)
);
"""

_ACCEPTED = "expected a database of `taction sweep` or `montecarlo`, or the name of a new file"
_LINES = b'{"kind": "taction samples'  # beginning of a file of samples by older versions
_OLD_SAMPLES = (
    "the samples are lines of JSON, written by an older taction; this taction cannot read them."
    " Give another name to draw the samples again, or use the taction that wrote them"
)
_CORRUPT = (
    "the database is damaged and was not changed; `sqlite3 FILE .recover` may save its points;"
    " start anew with another name"
)
_NOT_A_DATABASE = "SQLITE_NOTADB"
_MESSAGES = {  # by the beginnings of SQLite's error names
    (_NOT_A_DATABASE,): f"the file is no SQLite database; {_ACCEPTED}. It was not changed",
    ("SQLITE_CORRUPT",): _CORRUPT,
    ("SQLITE_READONLY", "SQLITE_PERM"): "the file cannot be written; give it write permission, or"
    " give another name",
    ("SQLITE_CANTOPEN",): "the file cannot be opened or made; does the folder exist, and may you"
    " write to it?",
    ("SQLITE_BUSY", "SQLITE_LOCKED"): f"another process has locked the file for {PATIENCE:g} s;"
    " is that process suspended?",
}
_FULL = ("SQLITE_FULL", "SQLITE_IOERR")


@dataclass(frozen=True, slots=True)
class StoredResult:
    """The result of one point or sample."""

    outcome: str  # "pass", "fail", "inconclusive", or `ERROR`
    record: dict[str, Any]  # plain data, see `verification.studies.sweep.point`
    waveforms: bytes | None = None  # a compressed .npz, if waveforms are kept


class Store:
    """A database of results; a context manager that closes the database.

    Parameters
    ----------
    path : str
        The file, made if missing; ``":memory:"`` for a database in memory.

    Raises
    ------
    InputError
        Not such a database, damaged, of another version, or not writable. Raised by every method.
    OutOfDisk
        Raised by `put`; the results stored before are intact.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        with self._explained():
            self._db = sqlite3.connect(
                path, timeout=PATIENCE, isolation_level=None, check_same_thread=False
            )  # the garbage collector may close it in another thread
            try:
                self._prepare()
            except BaseException:
                self._db.close()
                raise
        weakref.finalize(self, self._db.close)  # for a store that a SweepResult keeps open

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self._db.close()

    def key_of(self, request: bytes) -> bytes | None:
        """Return the key of the point that belongs to `request`, if it is stored."""
        key: bytes | None = self._value("select key from requests where request = ?", request)
        return key

    def outcome_of(self, key: bytes) -> str | None:
        """Return the outcome of a point, if it is stored."""
        outcome: str | None = self._value("select outcome from points where key = ?", key)
        return outcome

    def has_waveforms(self, key: bytes) -> bool:
        """Whether the waveforms of a point are stored."""
        return self._value("select 1 from waveforms where key = ?", key) is not None

    def record_of(self, request: bytes) -> dict[str, Any] | None:
        """Return the record of the point that belongs to `request`, if it is stored."""
        query = "select record from points join requests using (key) where request = ?"
        text = self._value(query, request)
        record: dict[str, Any] | None = None if text is None else json.loads(text)
        return record

    def waveforms(self, key: bytes) -> bytes | None:
        """Return the waveforms of a point as a compressed ``.npz``."""
        data: bytes | None = self._value("select data from waveforms where key = ?", key)
        return data

    def count(self) -> int:
        """Return the number of stored points."""
        return int(self._value("select count(*) from points") or 0)

    def link(self, request: bytes, key: bytes) -> None:
        """Store that `request` belongs to the point `key`."""
        with self._transaction():
            self._link(request, key)

    def put(self, key: bytes, result: StoredResult, request: bytes) -> None:
        """Store a result in one transaction; a result stored before stays, unless it is an error.

        `key` is the digest of the inputs of the result, `request` that of the requested scene.
        """
        text = json.dumps(result.record, allow_nan=False, separators=(",", ":"))
        with self._transaction():
            self._db.execute(
                "insert into points (key, outcome, record) values (?, ?, ?)"
                " on conflict (key) do update set outcome = excluded.outcome,"
                " record = excluded.record, stored = current_timestamp where outcome = ?",
                (key, result.outcome, text, ERROR),
            )
            if result.waveforms is not None:
                query = "insert or ignore into waveforms (key, data) values (?, ?)"
                self._db.execute(query, (key, result.waveforms))
            self._link(request, key)

    def _link(self, request: bytes, key: bytes) -> None:
        self._db.execute("insert or replace into requests values (?, ?)", (request, key))

    def _value(self, query: str, *parameters: object) -> Any:
        """Return the first column of the first row, or None without a row."""
        with self._explained():
            row = self._db.execute(query, parameters).fetchone()
        return None if row is None else row[0]

    def _prepare(self) -> None:
        """Check the database, or make its tables; two processes may do so at once."""
        if not self._value("select count(*) from sqlite_master"):
            self._create()
        if self._value("pragma application_id") != APPLICATION:
            raise self._error(f"a database of another program; {_ACCEPTED}. It was not changed")
        if (other := self._value("pragma user_version")) != FORMAT:
            raise self._error(
                f"results of format {other}, this taction has {FORMAT}; the two cannot be mixed."
                " The file was not changed; start anew with another name"
            )
        problem = self._value("pragma quick_check(1)")
        if problem != "ok":
            raise self._error(f"{_CORRUPT} ({problem})")
        if self._value("pragma journal_mode") != "wal":
            self._db.execute("pragma journal_mode = wal")
        self._db.execute("pragma synchronous = normal")

    def _create(self) -> None:
        with self._transaction():
            if not self._db.execute("select count(*) from sqlite_master").fetchone()[0]:
                for statement in SCHEMA.split(";\n"):
                    self._db.execute(statement)
                self._db.execute(f"pragma application_id = {APPLICATION}")
                self._db.execute(f"pragma user_version = {FORMAT}")

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        with self._explained():
            self._db.execute("begin immediate")
            try:
                yield
                self._db.execute("commit")
            except BaseException:
                if self._db.in_transaction:
                    self._db.execute("rollback")
                raise

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn an error of SQLite into an error that says what to do."""
        try:
            yield
        except sqlite3.Error as error:
            name = getattr(error, "sqlite_errorname", "")
            if name.startswith(_FULL):
                raise OutOfDisk(
                    f"{self.path}: {error}. All earlier points are stored; make room on the disk"
                    " and run the same command again to continue"
                ) from error
            texts = (text for names, text in _MESSAGES.items() if name.startswith(names))
            text = next(texts, f"{error}; {_ACCEPTED}")
            if name == _NOT_A_DATABASE and Path(self.path).read_bytes().startswith(_LINES):
                text = _OLD_SAMPLES
            raise self._error(text) from error

    def _error(self, text: str) -> InputError:
        return InputError(self.path, Complaint("database", "", text))
