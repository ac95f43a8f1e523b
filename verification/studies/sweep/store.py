"""Results of studies in one SQLite file: a transaction a point, nothing run twice, nothing lost.

The file has a write-ahead log: a process that is killed at any instant loses nothing that was
stored, a power cut at most the last moments and never the file, and a transaction costs 0.1 ms. A
rollback journal would wait for the disk at every point, 1.5 ms on an idle machine and 22 ms beside
simulations that write to it (measured). While a sweep runs, and after a kill, the log stands
beside the file as FILE-wal; the next one that opens the file merges it.
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
PATIENCE = 60.0  # s that another process may hold the file
ERROR = "error"  # outcome of a point that reached no verdict at all

SCHEMA = """
create table points (
    key blob primary key,       -- digest of circuit, problem, analysis, checks, engine, simulator
    outcome text not null,      -- pass, fail, inconclusive, error
    record text not null,       -- JSON, SI base units
    stored text not null default current_timestamp
) without rowid;
create table requests (
    request blob primary key,   -- digest of a scene with its changes
    key blob not null           -- the point that it came down to
) without rowid;
create table waveforms (
    key blob primary key,
    data blob not null          -- a compressed .npz: time (s), u (V)
);
"""

_ACCEPTED = "expected a database of `taction sweep` or `montecarlo`, or a name that is free"
_LINES = b'{"kind": "taction samples'  # how a file of samples began before they came in here
_WRONG = {  # what SQLite says, and what it means for the user
    "SQLITE_NOTADB": f"this is no SQLite database; {_ACCEPTED}. It was left as it is",
    "LINES": "samples as lines of JSON, as taction kept them before; they cannot be read any more."
    " Give another name, and they are drawn again, or take the taction that wrote them",
    "SQLITE_CORRUPT": "the database is damaged and was left as it is; `sqlite3 FILE .recover`"
    " may save its points; start anew with another name",
    "SQLITE_READONLY": "it cannot be written; give it write permission, or another name",
    "SQLITE_PERM": "it cannot be written; give it write permission, or another name",
    "SQLITE_CANTOPEN": "it cannot be opened or made; is the folder there, may you write to it?",
    "SQLITE_BUSY": f"another process has locked it for {PATIENCE:g} s; is one stopped?",
    "SQLITE_LOCKED": f"another process has locked it for {PATIENCE:g} s; is one stopped?",
}
_FULL = ("SQLITE_FULL", "SQLITE_IOERR")


@dataclass(frozen=True, slots=True)
class Row:
    """One stored result.

    Attributes
    ----------
    key : bytes
        What it is the result of.
    outcome : str
        ``"pass"``, ``"fail"``, ``"inconclusive"``, or ``"error"`` where nothing was reached.
    record : dict
        Plain data, see `verification.studies.sweep.point`.
    waveforms : bytes or None
        A compressed ``.npz``, where it was to be kept.
    """

    key: bytes
    outcome: str
    record: dict[str, Any]
    waveforms: bytes | None = None


class Store:
    """A database of results; a context manager that closes it.

    Parameters
    ----------
    path : str
        The file, made where there is none; ``":memory:"`` for none at all.

    Raises
    ------
    InputError
        Not such a database, damaged, of another version, or not writable. From here or from any
        method.
    OutOfDisk
        From `put`; what was stored before is intact.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        with self._explained():
            self._db = sqlite3.connect(
                path, timeout=PATIENCE, isolation_level=None, check_same_thread=False
            )  # a collector in another thread may close it
            try:
                self._prepare()
            except BaseException:
                self._db.close()
                raise
        weakref.finalize(self, self._db.close)  # of a store that a result holds open

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self._db.close()

    def key_of(self, request: bytes) -> bytes | None:
        """Return the key of the point that `request` came down to, if it was met before."""
        found: bytes | None = self._one("select key from requests where request = ?", request)
        return found

    def outcome_of(self, key: bytes) -> str | None:
        """Return how a point ended, if it is stored."""
        found: str | None = self._one("select outcome from points where key = ?", key)
        return found

    def has_waveforms(self, key: bytes) -> bool:
        """Whether the waveforms of a point are stored."""
        return self._one("select 1 from waveforms where key = ?", key) is not None

    def row(self, request: bytes) -> Row | None:
        """Return the result of `request`, without waveforms, if it is stored."""
        with self._explained():
            found = self._db.execute(
                "select key, outcome, record from points join requests using (key)"
                " where request = ?",
                (request,),
            ).fetchone()
        return None if found is None else Row(found[0], found[1], json.loads(found[2]))

    def waveforms(self, key: bytes) -> bytes | None:
        """Return the waveforms of a point as a compressed ``.npz``."""
        found: bytes | None = self._one("select data from waveforms where key = ?", key)
        return found

    def count(self) -> int:
        """Return the number of stored points."""
        return int(self._one("select count(*) from points") or 0)

    def link(self, request: bytes, key: bytes) -> None:
        """Note that `request` comes down to the stored point `key`."""
        with self._transaction():
            self._link(request, key)

    def put(self, row: Row, request: bytes) -> None:
        """Store a result in one transaction.

        A result that is there already stays, whoever made it, unless it is an error.
        """
        text = json.dumps(row.record, allow_nan=False, separators=(",", ":"))
        with self._transaction():
            self._db.execute(
                "insert into points (key, outcome, record) values (?, ?, ?)"
                " on conflict (key) do update set outcome = excluded.outcome,"
                " record = excluded.record, stored = current_timestamp where outcome = ?",
                (row.key, row.outcome, text, ERROR),
            )
            if row.waveforms is not None:
                self._db.execute(
                    "insert or ignore into waveforms (key, data) values (?, ?)",
                    (row.key, row.waveforms),
                )
            self._link(request, row.key)

    def _link(self, request: bytes, key: bytes) -> None:
        self._db.execute("insert or replace into requests values (?, ?)", (request, key))

    def _one(self, query: str, *values: object) -> Any:
        with self._explained():
            found = self._db.execute(query, values).fetchone()
        return None if found is None else found[0]

    def _prepare(self) -> None:
        """Check what is there, or make the tables; two processes may do so at once."""
        if not self._one("select count(*) from sqlite_master"):
            self._create()
        if self._one("pragma application_id") != APPLICATION:
            raise self._wrong(f"a database of another program; {_ACCEPTED}. It was left as it is")
        if (other := self._one("pragma user_version")) != FORMAT:
            text = (
                f"results of format {other}, this taction has {FORMAT}; the two"
                " cannot be mixed. It was left as it is; start anew with another name"
            )
            raise self._wrong(text)
        problem = self._one("pragma quick_check(1)")
        if problem != "ok":
            raise self._wrong(f"{_WRONG['SQLITE_CORRUPT']} ({problem})")
        if self._one("pragma journal_mode") != "wal":
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
        """Turn what SQLite raises into an error that says what to do."""
        try:
            yield
        except sqlite3.Error as error:
            name = getattr(error, "sqlite_errorname", "")
            if name.startswith(_FULL):
                raise OutOfDisk(
                    f"{self.path}: {error}. Every point before this one is stored; make room and"
                    " run the same command again to go on"
                ) from error
            kind = next((kind for kind in _WRONG if name.startswith(kind)), None)
            if kind == "SQLITE_NOTADB" and Path(self.path).read_bytes().startswith(_LINES):
                kind = "LINES"
            raise self._wrong(_WRONG[kind] if kind else f"{error}; {_ACCEPTED}") from error

    def _wrong(self, text: str) -> InputError:
        return InputError(self.path, Complaint("database", "", text))
