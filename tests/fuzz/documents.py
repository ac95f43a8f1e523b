"""Documents: imported op-amps, baselines, and databases of studies."""

from __future__ import annotations

import copy
import functools
import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from taction.netlist_gen.board.opamp_choice import as_opamp, from_document, to_document
from taction.system.documents import plain
from taction.system.errors import Complaint, InputError
from taction.verification.studies.regression.regress import baseline_text, load_baseline
from taction.verification.studies.running.store import Store
from taction.verification.verdict.record import Record
from tests.fuzz.edits import BYTE_EDITS, IN_PLACE, VALUE_EDIT, Target, edited
from tests.support.entries import entry, make_record
from tests.support.paths import DATA

OPAMP = (DATA / "fet100.opamp.json").read_bytes()
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2.5, -0.0, 1e-300, 1e308, -1e308, 10**40, 10**400, -(10**400)),
    *(math.nan, math.inf, -math.inf, "", "x", "1.5", "\n::error::x", "\x1b[2J", "\udcff"),
    *("x" * 9000, [], {}, [None], [[1.0]], [1.0, 2.0, 3.0], {"a": None}, [[]] * 40, "none"),
    "ua741",
)


def _places(data: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the way to every value of a document."""
    inner = data.items() if isinstance(data, dict) else enumerate(data)
    for key, item in inner:
        yield (*place, key)
        if isinstance(item, dict | list):
            yield from _places(item, (*place, key))


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Draw a document in which up to three values are others, missing, or stand twice."""
    data = copy.deepcopy(json.loads(content))
    for _ in range(draw(st.integers(0, 3))):
        places = list(_places(data))
        *way, key = draw(st.sampled_from(places))
        inside = data
        for name in way:
            inside = inside[name]
        kind = draw(st.sampled_from(("replace", "replace", "replace", "remove", "add")))
        if kind == "remove":
            del inside[key]
        elif kind == "add" and isinstance(inside, list):
            inside.append(copy.deepcopy(draw(st.sampled_from(VALUES))))
        else:
            inside[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
        if not isinstance(data, dict) or not data:
            break
    return json.dumps(data).encode()


def _inputs(content: bytes) -> st.SearchStrategy[bytes]:
    return st.one_of(damaged(content), damaged(content), edited([content], [*BYTE_EDITS]))


def _examine_opamp(content: bytes, folder: Path) -> str:
    """Accept what is written again with the same numbers."""
    try:
        data = json.loads(content)
        name, imported = from_document(data)
        as_opamp(name, imported)
    except (ValueError, RecursionError) as error:  # what `imported_opamp` names
        raise InputError("a.opamp.json", Complaint("file", "", str(error) or "deep")) from None
    again = json.loads(json.dumps(to_document(name, imported)))
    for key in ("figures", "linear", "supply", "pins", "name"):
        assert _kept(again[key], data[key])
    return "accepted, the same numbers"


def _kept(here: Any, there: Any) -> bool:
    """Whether values are those of a file; what it lacks is empty."""
    if isinstance(here, dict):
        return all(_kept(own, there[key]) if key in there else not own for key, own in here.items())
    if isinstance(here, list):
        return len(here) == len(there) and all(map(_kept, here, there))
    return bool(here == there)


DOCUMENTS = (Target("imported op-amps", _inputs(OPAMP), _examine_opamp),)

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


@functools.cache
def _database() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.sqlite"
        with Store(str(path)) as store:
            for key, result in zip(KEYS, RESULTS, strict=True):
                store.put(key, result)
        return path.read_bytes()


def _examine_results(content: bytes, folder: Path) -> str:
    """Read every point; store what is missing again, as a sweep does; read again."""
    path = folder / "a.sqlite"
    path.write_bytes(content)
    missing = 0
    with Store(str(path)) as store:
        for attempt in range(2):
            store.count()
            for key, result in zip(KEYS, RESULTS, strict=True):
                record = store.record_of(key, Record)
                if attempt == 0 and record is None:
                    missing += 1
                    store.put(key, result)
                elif attempt == 1:
                    assert record is not None, "a point that was stored again is missing"
    return "some points computed again" if missing else "all points read"


BASELINE = baseline_text(ENTRIES).encode()
DATABASES = st.deferred(lambda: edited([_database()], [*IN_PLACE * 6, *BYTE_EDITS]))

STORED_FILES = (
    Target("baselines", edited([BASELINE], [VALUE_EDIT, *BYTE_EDITS]), _examine_baseline),
    Target("databases of sweeps", DATABASES, _examine_results),
)
