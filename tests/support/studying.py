"""Small scenes and executors for tests of studies over varied boards."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.scene import Scene
from taction.verification.studies.running.study import Workers
from tests.support.making import NEAR_IDEAL, make_scene

QUIET = {"resistor": 0, "capacitor": 0, "stray": 0, "opamp_gbw": 0, "opamp_gain": 0}
DAMPED = {"capacitance": "100pF", "gain": "100kohm", "stray_capacitance": 0.0, "opamp": NEAR_IDEAL}
IDEAL = """[design]
gain = "100kohm"
capacitance = "100pF"
stray_capacitance = 0
opamp = { base = "ideal", dc_gain = 1e12 }
"""
TEXT = """name = "two"
[problem]
kind = "tactile"
channels = 2
span = 1.2
[design]
capacitance = "100pF"
gain = "100kohm"
stray_capacitance = 0
opamp = { base = "ideal", dc_gain = 1e12 }
[checks]
steady_state = { tolerance = 0.005 }
settling_time = { band = 0.1 }
"""


def small_scene(**tables: Any) -> Scene:
    """Two channels with ideal op-amps, by the state-space engine."""
    tables = {"design": DAMPED, "analysis": {"engine": "statespace"}} | tables
    return make_scene({"channels": 2, "span": 1.2}, **tables)


def scene_file(folder: Path, rest: str = "") -> str:
    """Write the same scene, with a steady-state limit that some samples do not keep."""
    path = folder / "two.toml"
    path.write_text(TEXT + rest, encoding="utf-8")
    return str(path)


@contextmanager
def one_thread() -> Iterator[Workers]:
    """Run samples in this process, one at a time."""
    with ThreadPoolExecutor(1) as executor:
        yield Workers(executor, 1, spare=1)


class Failing(ThreadPoolExecutor):
    """Workers of which every so many tasks, from the first on, end with an error."""

    def __init__(self, error: Exception, every: int = 1) -> None:
        super().__init__(1)
        self.tasks, self.error, self.every = 0, error, every

    def submit(self, *task: Any, **given: Any) -> Future[Any]:
        self.tasks += 1
        if (self.tasks - 1) % self.every:
            return super().submit(*task, **given)
        failed: Future[Any] = Future()
        failed.set_exception(self.error)
        return failed


def stored_samples(file: Path) -> list[dict[str, Any]]:
    """Return the samples in a database, by their numbers; none where there is no database yet."""
    try:
        with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True, timeout=10)) as database:
            rows = database.execute("select record from points").fetchall()
    except sqlite3.OperationalError:
        return []
    found: list[dict[str, Any]] = [json.loads(record) for (record,) in rows]
    return sorted(found, key=lambda sample: int(sample["number"]))
