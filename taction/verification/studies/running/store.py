"""Results of studies in one SQLite file, one transaction a point.

The file has a write-ahead log: killing the process loses no stored result, a power cut at most
those of the last moments and never the file. A rollback journal would wait for the disk at every
point, 1.5 to 22 ms instead of 0.1 ms.
"""

from __future__ import annotations

import json
import sqlite3
import weakref
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from taction.system.documents import plain, read
from taction.system.errors import Complaint, InputError, OutOfDisk

T = TypeVar("T")

PATIENCE = 60.0  # s to wait for another process that has locked the file
APPLICATION = 0x7461_6374  # "tact", in the file's header
FORMAT = 5  # of the results; a change in what a record or a key means gets a new number
HEAD = b"SQLite format 3\0"

ACCEPTED = "expected a database of `taction sweep` or `montecarlo`, or the name of a new file"
CORRUPT = (
    "the database is damaged and was not changed; `sqlite3 FILE .recover` may save its points;"
    " start anew with another name"
)
NOT_A_DATABASE = f"the file is no SQLite database; {ACCEPTED}. It was not changed"
MESSAGES = {  # by the beginnings of SQLite's error names
    "SQLITE_NOTADB": NOT_A_DATABASE,
    "SQLITE_CORRUPT": CORRUPT,
    "SQLITE_BUSY": "another process has locked the file for a minute",
}
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
do update set outcome = excluded.outcome, record = excluded.record where outcome = 'error'
"""


class Store(AbstractContextManager["Store"]):
    """A database of results in a file, or in ``":memory:"``; a context manager that closes it.

    Every method raises InputError for a database that is damaged, of another version or not
    writable.
    """

    path: str

    def __init__(self, path: str) -> None:
        self.path, file = path, Path(path)
        if file.exists() and not file.is_file():
            raise _unusable(path, f"not a regular file; {ACCEPTED}")
        with suppress(OSError), file.open("rb") as opened:  # SQLite says why it cannot be read
            if opened.read(len(HEAD)) not in (b"", HEAD):
                raise _unusable(path, NOT_A_DATABASE)
        with self._explained():
            self._db = sqlite3.connect(
                path, timeout=PATIENCE, isolation_level=None, check_same_thread=False
            )  # the garbage collector may close it in another thread
            weakref.finalize(self, self._db.close)  # for a store that a SweepResult keeps open
            try:
                self._prepare()
            except BaseException:
                self._db.close()
                raise

    def __exit__(self, *error: object) -> None:
        self._db.close()

    def outcome_of(self, key: bytes) -> str | None:
        """Return the outcome of a point, if it is stored."""
        outcome: str | None = self._value("select outcome from points where key = ?", key)
        return outcome

    def record_of(self, key: bytes, kind: type[T]) -> T | None:
        """Return the result of a point as a `kind`, such as a `Record`, if it is stored."""
        text = self._value("select record from points where key = ?", key)
        try:
            return None if text is None else read(kind, json.loads(text))
        except ValueError as error:
            raise _unusable(self.path, f"{CORRUPT} (a stored record: {error})") from None

    def count(self) -> int:
        """Return the number of stored points."""
        return int(self._value("select count(*) from points") or 0)

    def put(self, key: bytes, result: Any) -> None:
        """Store a record or a sample in one transaction; one that is no error stays as it is."""
        text = json.dumps(plain(result), allow_nan=False, separators=(",", ":"))
        with self._explained():
            self._db.execute(PUT, (key, result.outcome, text))

    def _value(self, query: str, *parameters: object) -> Any:
        """Return the first column of the first row, or None without a row."""
        with self._explained():
            row = self._db.execute(query, parameters).fetchone()
        return None if row is None else row[0]

    def _prepare(self) -> None:
        """Check the database, or make its tables; two processes may do so at once."""
        if not self._value("select count(*) from sqlite_master"):
            self._db.executescript(SCHEMA)
        if self._value("pragma application_id") != APPLICATION:
            text = f"a database of another program; {ACCEPTED}. It was not changed"
            raise _unusable(self.path, text)
        if (other := self._value("pragma user_version")) != FORMAT:
            text = f"results of format {other}, this taction has {FORMAT}; the two cannot be mixed."
            text += " The file was not changed; start anew with another name"
            raise _unusable(self.path, text)
        if (problem := self._value("pragma quick_check(1)")) != "ok":
            raise _unusable(self.path, f"{CORRUPT} ({problem})")
        if self._value("pragma journal_mode") != "wal":
            self._db.execute("pragma journal_mode = wal")
        self._db.execute("pragma synchronous = normal")

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn an error of SQLite in the block into an `InputError` or `OutOfDisk`."""
        try:
            yield
        except sqlite3.Error as error:
            name = getattr(error, "sqlite_errorname", "")
            if name.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
                raise OutOfDisk(
                    f"{self.path}: {error}. All earlier points are stored; make room on the disk"
                    " and run the same command again to continue"
                ) from error
            texts = (text for known, text in MESSAGES.items() if name.startswith(known))
            raise _unusable(self.path, next(texts, f"{error}; {ACCEPTED}")) from error
        except UnicodeDecodeError as error:  # SQLite's message quotes a damaged name
            raise _unusable(self.path, CORRUPT) from error


def _unusable(path: str, text: str) -> InputError:
    return InputError(path, Complaint("database", "", text))
