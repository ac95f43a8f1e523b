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
from typing import Any, Protocol, TypeVar

from taction.system.documents import plain, read
from taction.verification.studies.store_file import (
    ACCEPTED,
    CORRUPT,
    PATIENCE,
    check_database,
    explained,
    unusable,
)
from taction.verification.verdict.record import ERROR

T = TypeVar("T")

APPLICATION = 0x7461_6374  # "tact", in the file's header
FORMAT = 4  # of the results; a change in what a record means gets a new number

SCHEMA = f"""
begin immediate;
create table if not exists points (
    key blob primary key,       -- digest of scene, engine, simulator and the source of taction
    outcome text not null,      -- pass, fail, inconclusive, error
    record text not null,       -- JSON, SI base units
    stored text not null default current_timestamp
) without rowid;
pragma application_id = {APPLICATION};
pragma user_version = {FORMAT};
commit;
"""
PUT = """
insert into points (key, outcome, record) values (?, ?, ?) on conflict (key)
do update set outcome = excluded.outcome, record = excluded.record where outcome = ?
"""


class HasOutcome(Protocol):
    """What is stored of a point or a sample: a `Record`, or a type that contains one."""

    @property
    def outcome(self) -> str:
        """``"pass"``, ``"fail"``, ``"inconclusive"`` or `ERROR`."""


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

    def outcome_of(self, key: bytes) -> str | None:
        """Return the outcome of a point, if it is stored."""
        outcome: str | None = self._value("select outcome from points where key = ?", key)
        return outcome

    def plain_of(self, key: bytes) -> dict[str, Any] | None:
        """Return the result of a point as it was stored, plain data, if it is stored."""
        return self.record_of(key, dict[str, Any])

    def record_of(self, key: bytes, kind: type[T]) -> T | None:
        """Return the result of a point as a `kind`, such as a `Record`, if it is stored."""
        text = self._value("select record from points where key = ?", key)
        try:
            return None if text is None else read(kind, json.loads(text))
        except ValueError as error:
            raise unusable(self.path, f"{CORRUPT} (a stored record: {error})") from None

    def count(self) -> int:
        """Return the number of stored points."""
        return int(self._value("select count(*) from points") or 0)

    def put(self, key: bytes, result: HasOutcome) -> None:
        """Store a result in one transaction; a result stored before stays, unless it is an error.

        `key` is the digest of all that the result depends on.
        """
        text = json.dumps(plain(result), allow_nan=False, separators=(",", ":"))
        with explained(self.path):
            self._db.execute(PUT, (key, result.outcome, text, ERROR))

    def _value(self, query: str, *parameters: object) -> Any:
        """Return the first column of the first row, or None without a row."""
        with explained(self.path):
            row = self._db.execute(query, parameters).fetchone()
        return None if row is None else row[0]

    def _prepare(self) -> None:
        """Check the database, or make its tables; two processes may do so at once."""
        if not self._value("select count(*) from sqlite_master"):
            self._db.executescript(SCHEMA)
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
