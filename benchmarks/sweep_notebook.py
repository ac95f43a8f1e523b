"""The same result as a sweep's, kept by hand: measured against the reference, a row a point."""

from __future__ import annotations

import json
import sqlite3
import threading
from pathlib import Path
from typing import Any

from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.ideal.ideal_answer import ideal_network
from verification.measures.measure import measure
from verification.measures.measurements import Measurements
from verification.reference import solve


class Notebook:
    """Keeps measured results: what a user of another runner would have to write.

    Parameters
    ----------
    path : Path
        A new database.
    scenes : list of Scene
        One a deck; they share one problem.
    """

    def __init__(self, path: Path, scenes: list[Scene]) -> None:
        self._scenes = scenes
        self._problem = make_problem(scenes[0])
        self._one_at_a_time = threading.Lock()
        self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        self._db.execute("pragma journal_mode = wal")
        self._db.execute("pragma synchronous = normal")
        self._db.execute("create table points (key integer primary key, record text not null)")

    def keep(self, point: int, time: Floats, u: Floats) -> None:
        """Measure `u` (P, N), V, against the reference and store what was found."""
        scene = self._scenes[point]
        network = ideal_network(self._problem, scene)
        target = solve(network.problem).u * network.U0
        found = measure(time, u, target, band=scene.checks.settling_time.band)
        row = (point, json.dumps(_record(found)))
        with self._one_at_a_time:
            self._db.execute("insert into points values (?, ?)", row)

    def close(self) -> None:
        """Close the database."""
        self._db.close()


def _record(found: Measurements) -> dict[str, Any]:
    channels = found.channels
    rises = [c.rise_time.value for c in channels if c.rise_time is not None]
    error = max(abs(c.final - c.target) for c in channels) / found.amplitude
    return {
        "settling_time": None if found.settling_time is None else found.settling_time.value,
        "rise_time": max(rises, default=None),
        "overshoot": max(c.overshoot for c in channels),
        "steady_state_error": error,
        "step_amplitude": found.amplitude,
        "state": [c.state.value for c in channels],
        "frequency": [c.frequency for c in channels],
        "growth_rate": [c.growth_rate for c in channels],
    }
