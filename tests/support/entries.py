"""Entries of a baseline, records of sweeps and trials of designs made by hand; a quick scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.axes import parse_axes
from taction.netlist_gen.scene.keys import Value
from taction.system.documents import read
from taction.system.reading_definitions import READINGS
from taction.verification.design.trials import Trial
from taction.verification.studies.regression.regress import Entry
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep import Plan, grid_points
from taction.verification.studies.tolerance.montecarlo import BoardSample
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import FIGURES, Figure, Record
from tests.support.studying import small_scene


def entry(**changes: Any) -> Entry:
    """An entry of one output that rises to 1 V; `changes` are keys of its plain data."""
    fields: dict[str, Any] = {
        "name": "one",
        "keys": {"design.capacitance": "10pF"},
        "taction": "0.1.0",
        "solved_by": "ngspice-46, KLU, trapezoidal",
        "outcome": "pass",
        "engine": "ngspice",
        "checks": [{"name": "stability", "outcome": "pass"}],
        "step_amplitude": 1.0,
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


def grid_plan(*over: str) -> Plan:
    scene = small_scene()
    return Plan(scene, parse_axes(scene, over), "statespace")


def make_record(engine: str = "statespace", **changes: Any) -> Record:
    """A record that passes; `changes` are figures, readings of `reading`, and other fields."""
    names = {field.name for field in fields(Record)}
    figures: dict[str, float | None] = dict.fromkeys(FIGURES, 1.0)
    figures |= {"wanted_error": 2.5e-4, "attained_error": 1e-4}
    bounds: dict[str, float | None] = dict.fromkeys((*READINGS, "end_error"), 1e-3)
    others: dict[str, float] = {}
    for name, value in changes.items():
        if isinstance(value, Figure):
            figures[name], bounds[name] = value.value, value.uncertainty
            others |= {} if value.alternative is None else {name: value.alternative}
        elif name not in names:
            figures[name] = value
    record = Record(
        "pass",
        engine,
        engine,
        state="settled",
        stable=True,
        figures=figures,
        uncertainties=bounds,
        alternatives=others,
        checks=(make_check("stability", "pass"),),
    )
    return replace(record, **{name: v for name, v in changes.items() if name in names})


def make_sample(
    number: int, outcome: str = "pass", failed: tuple[str, ...] = (), **changes: Any
) -> BoardSample:
    """A sample whose checks `failed` do not pass."""
    checks = tuple(make_check(name, "fail") for name in failed)
    return BoardSample(number, make_record(outcome=outcome, checks=checks, **changes))


def make_check(name: str, outcome: str) -> Check:
    return Check(name, Outcome(outcome), 1.0, 0.1, None, None, "ratio", "")


def reading(
    value: float | None, uncertainty: float | None, alternative: float | None = None
) -> Figure:
    return Figure(value, "", uncertainty, alternative)


def store_records(plan: Plan, store: Store, records: dict[int, Record]) -> None:
    """Store records by place of the grid."""
    for place, _, key in grid_points(plan):
        record = records.get(place)
        if record is not None:
            store.put(key, record)


def make_trial(
    values: Mapping[str, Value],
    settling: float = math.inf,
    overshoot: float = math.inf,
    left: Sequence[str] = (),
    refused: str = "",
) -> Trial:
    """Return the trial of a stable board (without an overshoot: an unstable one)."""
    none = Record.without_verdict(Exception(), "statespace")
    names = dict.fromkeys(("made", *left), Outcome.PASS) | dict.fromkeys(left, Outcome.FAIL)
    checks = tuple(Check(n, o, None, None, None, None, "ratio", "") for n, o in names.items())
    record = replace(
        none,
        outcome="fail" if left else "pass",
        failure=None,
        stable=math.isfinite(overshoot),
        figures=none.figures
        | {
            "settling_time": settling if math.isfinite(settling) else None,
            "overshoot": overshoot if math.isfinite(overshoot) else None,
        },
        checks=checks,
    )
    return Trial(dict(values), record, refused)
