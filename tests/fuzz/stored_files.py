"""Baselines, and databases of sweeps and of Monte Carlo studies."""

from __future__ import annotations

import functools
import json
import tempfile
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from taction.system.documents import plain
from taction.verification.studies.regression.baseline import baseline_text, load_baseline
from taction.verification.studies.running.store import Store
from taction.verification.verdict.record import Record
from tests.fuzz.edits import BYTE_EDITS, IN_PLACE, VALUE_EDIT, edited
from tests.fuzz.target import Target
from tests.support.entries import entry
from tests.support.sweeping import make_record

ENTRIES = {"one.toml": entry(), "two.toml": entry(name="two", outcome="fail")}
KEYS = [bytes([number]) * 32 for number in range(6)]
RESULTS = [make_record(reason="x" * 300 * number) for number in range(6)]


def _examine_baseline(content: bytes, folder: Path) -> str:
    (folder / "baseline.json").write_bytes(content)
    entries = load_baseline(folder / "baseline.json")
    read = json.loads(content)["scenes"]
    assert {name: _plain(plain(found)) for name, found in entries.items()} == _plain(read)
    return "accepted, the same numbers"


def _plain(value: Any) -> Any:
    """Return data with every number as float, without the keys that hold nothing."""
    if isinstance(value, dict):
        known = {name: _plain(item) for name, item in value.items()}
        return {name: item for name, item in known.items() if item not in (None, "", {}, [])}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if isinstance(value, int | float) else value


def _fill(path: Path) -> None:
    with Store(str(path)) as store:
        for key, result in zip(KEYS, RESULTS, strict=True):
            store.put(key, result)


@functools.cache
def _database() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        _fill(Path(folder) / "a.sqlite")
        return (Path(folder) / "a.sqlite").read_bytes()


@functools.cache
def _with_log() -> tuple[bytes, bytes]:
    """Return a database and its write-ahead log, as a kill or a power cut leaves them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.sqlite"
        with Store(str(path)) as store:
            for key, result in zip(KEYS, RESULTS, strict=True):
                store.put(key, result)
            return path.read_bytes(), Path(f"{path}-wal").read_bytes()


def _examine_log(content: bytes, folder: Path) -> str:
    """A damaged log loses points, and changes none: its frames have checksums."""
    database, _ = _with_log()
    (folder / "a.sqlite-wal").write_bytes(content)
    return _examine_results(database, folder, exact=True)


def _examine_results(content: bytes, folder: Path, *, exact: bool = False) -> str:
    """Read every point; store what is missing again, as a sweep does; read again."""
    path = folder / "a.sqlite"
    path.write_bytes(content)
    missing = 0
    with Store(str(path)) as store:
        for attempt in range(2):
            store.count()
            for key, result in zip(KEYS, RESULTS, strict=True):
                record = store.record_of(key, Record)
                assert not exact or record in (None, result), "a wrong record was believed"
                if attempt == 0 and record is None:
                    missing += 1
                    store.put(key, result)
                elif attempt == 1:
                    assert record is not None, "a point that was stored again is missing"
    return "some points computed again" if missing else "all points read"


BASELINE = baseline_text(ENTRIES).encode()
DATABASES = st.deferred(lambda: edited([_database()], [*IN_PLACE * 6, *BYTE_EDITS]))

LOGS = st.deferred(lambda: edited([_with_log()[1]], [*IN_PLACE * 6, *BYTE_EDITS]))

STORED_FILES = (
    Target("baselines", edited([BASELINE], [VALUE_EDIT, *BYTE_EDITS]), _examine_baseline),
    Target("databases of sweeps", DATABASES, _examine_results),
    Target("write-ahead logs of databases", LOGS, _examine_log),
)
