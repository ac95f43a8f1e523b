"""Entries of a baseline, and a scene that is quick to verify, for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from taction.system.documents import read
from taction.verification.studies.regression.baseline import Entry


def entry(**changes: Any) -> Entry:
    """An entry of one output that rises to 1 V; `changes` are keys of its plain data."""
    fields: dict[str, Any] = {
        "name": "one",
        "fingerprint": "f" * 64,
        "taction": "0.1.0",
        "solved_by": "ngspice-46, KLU, trapezoidal",
        "outcome": "pass",
        "engine": "ngspice",
        "checks": [{"name": "stability", "outcome": "pass"}],
        "step_amplitude": 1.0,
        "speed": 1e6,
        "channels": [channel()],
        "settling_time": 5e-6,
        "growth_rate": -1e6,
        "frequency": 0.0,
    }
    return read(Entry, fields | changes)


def channel(**changes: Any) -> dict[str, Any]:
    """The channel of an entry as plain data."""
    levels = {"reference": 1.0, "final": 1.0, "overshoot": 0.25, "undershoot": 0.0}
    return {"index": 1, "state": "settled", **levels, "rise_time": 2e-6} | changes


FAST = """
name = "fast"
[problem]
kind = "tactile"
channels = 3
span = 2.0
[analysis]
engine = "statespace"
[checks]
settling_time = {{ band = 0.01, max = "{limit}" }}
[design]
capacitance = "{capacitance}"
opamp = {{ base = "{opamp}", input_errors = "none" }}
"""


def write_fast(
    path: Path,
    *,
    limit: str = "1s",
    capacitance: str = "10pF",
    opamp: str = "ua741",
    more: str = "",
) -> Path:
    """Write a scene of three channels that is verified in some hundredths of a second."""
    text = FAST.format(limit=limit, capacitance=capacitance, opamp=opamp) + more
    path.write_text(text, encoding="utf-8")
    return path
