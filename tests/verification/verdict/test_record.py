"""Records of verdicts: what they state, the way back, and what two of them differ by."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.system.documents import plain, read
from taction.system.errors import SimulationError
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import (
    ERROR,
    FIGURES,
    Figure,
    Record,
    compare,
    within_uncertainties,
)
from taction.verification.verdict.verify import verify
from tests.support.studying import small_scene


def test_a_record_states_what_the_verdict_states_and_leads_back() -> None:
    verdict = verify(small_scene())
    record, settling = Record.of(verdict), verdict.measurements.settling_time
    assert (record.outcome, record.reason, record.failed) == ("pass", "", ())
    assert record.figure("settling_time") == Figure(settling.value, "s", settling.uncertainty)
    assert record.figures.keys() == FIGURES.keys()
    assert record.value("lambda") == verdict.circuit.value("lambda")
    assert record.checks == verdict.checks
    pole = verdict.poles.rightmost
    assert record.pole == pytest.approx((pole.real, abs(pole.imag)), rel=1e-12)
    assert record.engine == "statespace"
    assert record.figure("growth_rate").uncertainty == verdict.poles.resolution
    data = json.loads(json.dumps(plain(record), allow_nan=False))
    assert data["settling_time"] == record.value("settling_time")
    assert data["channels"][0]["reference"] == record.channels[0].figures["reference"]
    assert plain(read(Record, data)) == plain(record)
    with pytest.raises(ValueError, match="outcome"):
        read(Record, {name: value for name, value in data.items() if name != "outcome"})


def test_a_failed_verdict_says_why_and_without_a_verdict_there_is_a_record_too() -> None:
    scene = with_values(small_scene(), {"checks.settling_time.max": 1e-9})
    verdict = verify(scene)
    record = Record.of(verdict)
    assert verdict.outcome is Outcome.FAIL
    assert record.failed == ("settling_time",)
    assert re.fullmatch(r"settles to ±1 % in [\d.]+ [mu]s \(limit: at most 1 ns\)", record.reason)
    record = Record.without_verdict(SimulationError("a"), "ngspice", "x" * 9000)
    assert (record.outcome, record.failure, len(record.reason)) == (ERROR, "SimulationError", 4000)
    assert set(record.figures.values()) == {None}
    assert record.pole is None
    assert read(Record, plain(record)) == record


STABLE = Check("stability", Outcome.PASS, 1.0, 0.125, unit="s")


def make(value: float | None = 1.0, bound: float | None = 0.25, **changes: Any) -> Record:
    bounds = {} if bound is None else {"rise_time": bound}
    record = Record("pass", "statespace", None, figures={"rise_time": value}, uncertainties=bounds)
    return replace(record, checks=(STABLE,), **changes)


FAILED = replace(STABLE, outcome=Outcome.FAIL, value=2.0)
FRAGILE = {"alternatives": {"rise_time": 1.1}}
# A record beside that of 1 s with a bound of 0.25 s: what is compared, and the difference.
COMPARED = [
    (make(1.5), "figures", 1.5, 0.5, 0.5, False),  # both bounds are allowed
    (make(1.51), "figures", 1.51, 0.51, 0.5, True),
    (make(0.4), "figures", 0.4, -0.6, 0.5, True),
    (make(1.0, None), "figures", 1.0, 0.0, None, False),
    (make(1.1, None), "figures", 1.1, 0.1, None, None),  # an unknown bound decides nothing
    (make(None), "figures", None, None, None, True),  # what only one record has
    (make(3.0, **FRAGILE), "figures", 1.1, 0.1, 0.5, False),  # the nearest value counts
    (replace(make(), checks=()), "checks", None, None, None, True),
    (replace(make(), outcome="fail"), "outcome", "fail", None, None, True),
    (replace(make(), checks=(FAILED,)), "checks", "fail", None, None, True),
    (replace(make(), checks=(FAILED,)), "values", 2.0, 1.0, 0.25, True),
]


@pytest.mark.parametrize(("second", "group", "value", "off", "allowed", "beyond"), COMPARED)
def test_what_two_records_differ_by(
    second: Record, group: str, value: Any, off: Any, allowed: Any, beyond: bool | None
) -> None:
    (found,) = compare(make(), second, within_uncertainties, groups=(group,))
    assert (found.second, found.allowed, found.beyond) == (value, allowed, beyond)
    assert found.difference == (None if off is None else pytest.approx(off))
    assert found.unit == ("s" if group in ("figures", "values") else "")
    if group == "figures" and value is not None:
        (back,) = compare(second, make(), within_uncertainties, groups=(group,))
        assert back.first == value


def test_what_no_record_has_is_no_difference_and_two_alternatives_are_not_compared() -> None:
    allowed = within_uncertainties
    assert compare(make(None), make(None), allowed, groups=("figures",)) == ()
    (found,) = compare(make(3.0, **FRAGILE), make(9.0, **FRAGILE), allowed, groups=("figures",))
    assert found.beyond is True
