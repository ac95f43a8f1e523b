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
from typing import Any

from taction.verification.studies.running.versions import digest
from taction.verification.studies.store_file import (
    ACCEPTED,
    CORRUPT,
    PATIENCE,
    check_database,
    explained,
    unusable,
)
from taction.verification.verdict.record import ERROR, Record

APPLICATION = 0x7461_6374  # "tact", in the file's header
FORMAT = 3  # of the results; a change in what a record means gets a new number

SCHEMA = """
create table points (
    key blob primary key,       -- digest of circuit, problem, analysis, checks, engine, simulator
    outcome text not null,      -- pass, fail, inconclusive, error
    record text not null,       -- JSON, SI base units
    seal blob not null,         -- digest of key, outcome and record
    stored text not null default current_timestamp
) without rowid;
create table requests (
    request blob primary key,   -- digest of a scene with its changes
    key blob not null           -- the point with that circuit and analysis
) without rowid;
create table waveforms (
    key blob primary key,
    data blob not null,         -- a compressed .npz: time (s), u (V)
    seal blob not null          -- digest of key and data
);
"""


@dataclass(frozen=True, slots=True)
class StoredResult:
    """The result of one point or sample."""

    outcome: str  # "pass", "fail", "inconclusive", or `ERROR`
    row: dict[str, Any]  # plain data of a `Record`, or of a type that contains one
    waveforms: bytes | None = None  # a compressed .npz, if waveforms are kept

    @classmethod
    def of(cls, record: Record, waveforms: bytes | None = None) -> StoredResult:
        """Return the result with a record as its row."""
        return cls(record.outcome, record.to_plain(), waveforms)


class Store:
    """A database of results; a context manager that closes the database.

    A row whose digest is not that of its content is damaged: it counts as not stored.

    Parameters
    ----------
    path : str
        The file, made if missing; ``":memory:"`` for a database in memory.

    Attributes
    ----------
    damaged : set of bytes
        Keys of the damaged rows that were read and not replaced since.

    Raises
    ------
    InputError
        Not such a database, damaged, of another version, or not writable. Raised by every method.
    OutOfDisk
        Raised by `put`; the results stored before are intact.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.damaged: set[bytes] = set()
        check_database(path)
        with explained(self.path):
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
        key = self._value("select key from requests where request = ?", request)
        return key if isinstance(key, bytes) else None

    def outcome_of(self, key: bytes) -> str | None:
        """Return the outcome of a point, if it is stored."""
        row = self._row(key)
        return None if row is None else row[0]

    def has_waveforms(self, key: bytes) -> bool:
        """Whether the waveforms of a point are stored."""
        return self.waveforms(key) is not None

    def record_of(self, request: bytes) -> dict[str, Any] | None:
        """Return the plain data of the result that belongs to `request`, if it is stored."""
        key = self.key_of(request)
        row = None if key is None else self._row(key)
        record: dict[str, Any] | None = None if row is None else json.loads(row[1])
        return record

    def waveforms(self, key: bytes) -> bytes | None:
        """Return the waveforms of a point as a compressed ``.npz``."""
        found = self._fetch("select data, seal from waveforms where key = ?", key)
        if found is None or found[1] == digest(key, found[0]):
            data: bytes | None = None if found is None else found[0]
            return data
        self.damaged.add(key)
        return None

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
        text = json.dumps(result.row, allow_nan=False, separators=(",", ":"))
        with self._transaction():
            if self.outcome_of(key) in (None, ERROR):
                seal = digest(key, result.outcome.encode(), text.encode())
                query = "insert or replace into points (key, outcome, record, seal)"
                self._db.execute(f"{query} values (?, ?, ?, ?)", (key, result.outcome, text, seal))
            if (data := result.waveforms) is not None and not self.has_waveforms(key):
                query = "insert or replace into waveforms (key, data, seal) values (?, ?, ?)"
                self._db.execute(query, (key, data, digest(key, data)))
            self._link(request, key)
        self.damaged.discard(key)

    def _link(self, request: bytes, key: bytes) -> None:
        self._db.execute("insert or replace into requests values (?, ?)", (request, key))

    def _row(self, key: bytes) -> tuple[str, bytes] | None:
        """Return outcome and record of a point; None if it is not stored, or damaged."""
        # As bytes: damaged text may be no text at all.
        query = "select cast(outcome as blob), cast(record as blob), seal from points where key = ?"
        row = self._fetch(query, key)
        if row is None:
            return None
        outcome, record, seal = row
        if seal != digest(key, outcome, record):
            self.damaged.add(key)
            return None
        return outcome.decode(), record

    def _value(self, query: str, *parameters: object) -> Any:
        """Return the first column of the first row, or None without a row."""
        row = self._fetch(query, *parameters)
        return None if row is None else row[0]

    def _fetch(self, query: str, *parameters: object) -> tuple[Any, ...] | None:
        """Return the first row, or None without a row."""
        with explained(self.path):
            row: tuple[Any, ...] | None = self._db.execute(query, parameters).fetchone()
        return row

    def _prepare(self) -> None:
        """Check the database, or make its tables; two processes may do so at once."""
        if not self._value("select count(*) from sqlite_master"):
            self._create()
        if self._value("pragma application_id") != APPLICATION:
            raise unusable(
                self.path, f"a database of another program; {ACCEPTED}. It was not changed"
            )
        if (other := self._value("pragma user_version")) != FORMAT:
            raise unusable(
                self.path,
                f"results of format {other}, this taction has {FORMAT}; the two cannot be mixed."
                " The file was not changed; start anew with another name",
            )
        problem = self._value("pragma quick_check(1)")
        if problem != "ok":
            raise unusable(self.path, f"{CORRUPT} ({problem})")
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
        with explained(self.path):
            self._db.execute("begin immediate")
            try:
                yield
                self._db.execute("commit")
            except BaseException:
                if self._db.in_transaction:
                    self._db.execute("rollback")
                raise
