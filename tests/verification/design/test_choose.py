"""A choice: the grid, the order by hand-made records, and the command with ngspice."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import InputError
from taction.verification.design.choose import (
    CAPACITANCE,
    GAIN,
    best_designs,
    choice_plan,
    design_scene,
    designs,
)
from taction.verification.report.views.design_view import choice_view
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep import Plan, computed
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify
from tests.support.entries import make_record, store_records
from tests.support.making import make_scene
from tests.support.paths import ROOT
from tests.support.running import taction as command

FILE = str(ROOT / "scenes" / "tuned-breadboard.toml")
# The scene has R = 14.4 Mohm, and R falls as the gain grows: below 2.3 Mohm R would be worse.
TWO: dict[str, Any] = {
    "opamps": ["tl084", "ne5534"],
    "ranges": {CAPACITANCE: "10pF:22pF", GAIN: "2.4M:4.7M"},
    "points": 2,
    "limits": {"checks.settling_time.max": "1ms"},
}


def scene() -> Scene:
    return load_scene(FILE)


def record(settling: float = 1e-4, headroom: float = 0.5, outcome: str = "pass") -> Record:
    checks = (
        Check("settling_time", Outcome(outcome), settling, None, 1e-3),
        Check("headroom", Outcome.PASS, headroom, None, 0.9),
        Check("stability", Outcome.PASS, 2.5, None, 2.0),
    )
    reason = "" if outcome == "pass" else "!"
    return make_record(outcome=outcome, settling_time=settling, checks=checks, reason=reason)


def test_the_grid_has_values_that_can_be_bought_and_op_amps_that_work_at_the_supply() -> None:
    plan = choice_plan(scene(), ["tl084"], points=9)
    values = {axis.key.path: sorted(set(map(float, axis.values))) for axis in plan.axes[-2:]}
    farads, ohms = values[CAPACITANCE], values[GAIN]
    assert (plan.points, len(farads), len(ohms)) == (81, 9, 9)
    assert (farads[0], farads[-1]) == (1e-12, 1e-10)
    assert all(float(f"{v:.2e}") == v for v in (*farads, *ohms))
    assert plan.engine == "statespace"
    design = plan.scene.design
    assert design.lam == pytest.approx(0.0224385, rel=1e-5)
    assert design.opamp.level == "small-signal"  # above 90 % of a limit: inconclusive
    plan = choice_plan(scene(), ["ua741", "opa189"], points=2, limits={"design.supply": 2.5})
    assert (plan.scene.design.opamp.base, plan.shape) == ("opa189", (2, 2, 2))


def test_ngspice_contradicts_every_one_of_the_best() -> None:
    exact = with_values(scene(), {"design.opamp.input_errors": "none"})
    choice = taction.choose(
        exact, opamps=["ne5534"], c_range="10pF:22pF", gain_range="2.4M:4.7M", points=2, jobs=1
    )
    assert choice.outcome == "pass"
    contradicted = [replace(each, outcome=Outcome.FAIL) for each in choice.best]
    assert choice_view(replace(choice, best=contradicted)).outcome == "fail"


@pytest.mark.parametrize(
    ("names", "asked", "text"),
    [
        (["tl085"], {}, "tl084"),
        (["tl084"], {"ranges": {CAPACITANCE: "2pF:1pF"}}, "--c-range"),
        (["tl084"], {"ranges": {GAIN: "1M:x"}}, "gain"),
        (["tl084"], {"limits": {"checks.settling_time.max": "10 F"}}, "settling_time"),
        (["tl084"], {"points": 102}, "--points.*expected 1 to 101"),
        (["ua741", "lf353"], {"limits": {"design.supply": 2.5}}, "ua741 works at"),
    ],
)
def test_requests_that_cannot_be(names: list[str], asked: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        choice_plan(scene(), names, **asked)


def test_the_order_is_that_of_the_worst_share() -> None:
    """Settling 0.1 of 1 ms and headroom 0.5 of 0.9: 0.56; margin 2 (of the scene) of 2.5: 0.8."""
    made = {0: record(), 1: record(settling=9e-4), 2: record(headroom=0.8)}
    made |= {3: record(settling=2e-3, outcome="fail"), 5: record(settling=5e-4)}
    found = ranked(choice_plan(scene(), **TWO), made)
    assert [design.place for design in found] == [0, 5, 2, 1, 3]
    assert found[0].worst == pytest.approx(0.8)
    assert found[2].worst == pytest.approx(0.8 / 0.9)
    assert found[3].worst == pytest.approx(0.9)
    assert found[-1].record.failed == ("settling_time",)
    best = best_designs(found)
    assert [design.opamp for design in best] == ["tl084", "ne5534", "tl084"]
    assert [design.place for design in best] == [0, 5, 2]


def ranked(plan: Plan, made: dict[int, Record]) -> list[Any]:
    """Return the designs of a plan whose records are made by hand, the best first."""
    with Store(":memory:") as store:
        store_records(plan, store, made)
        return designs(plan, store)


def test_parts_that_cannot_be_bought_and_unstable_boards_are_never_best() -> None:
    """R = 1/(lambda s G0²) is 16.6 Mohm at s = 2 Mohm; C = 1 pF is below the stray 2.05 pF."""
    plan = choice_plan(scene(), ["tl084"], {CAPACITANCE: "1pF:10pF", GAIN: "2M:2.4M"}, 2)
    found = ranked(plan, {k: record() for k in range(4)})
    assert [design.place for design in best_designs(found)] == [3]
    refused = {design.place: design.refused for design in found}
    assert "resistors R above 10 Mohm" in refused[2]
    assert "capacitors C below the stray capacitance" in refused[1]
    plan = choice_plan(scene(), ["tl084"], {CAPACITANCE: "10pF:10pF", GAIN: "1M:1M"}, 1)
    (design,) = ranked(plan, {0: replace(record(outcome="fail"), stable=False)})
    assert (design.shares, design.settling_time) == ({}, float("inf"))
    assert not best_designs([design])


def test_the_command_confirms_by_ngspice(tmp_path: Path, ngspice: str) -> None:
    folder, file = tmp_path / "best", tmp_path / "board.toml"
    text = (ROOT / "scenes" / "tuned-breadboard.toml").read_text("utf-8")
    # At the conductances of this board the input errors decide; here the dynamics do.
    file.write_text(text.replace("opamp = { base", 'opamp = { input_errors = "none", base'))
    words = ["choose", str(file), "--settling", "1ms", "--overshoot", "8%"]
    words += ["--opamps", "ne5534,op27", "--c-range", "10pF:22pF"]
    words += ["--gain-range", "2.4M:4.7M", "--points", "2", "--jobs", "1"]
    words += ["--store", str(tmp_path / "a.sqlite"), "-o", str(folder), "--json"]
    found = command(*words)
    assert found.exit_code == 0, found.stderr
    document = json.loads(found.stdout)
    assert len(document["designs"]) == 8
    assert "computing 8 of 8 points" in found.stderr
    for best in document["best"]:
        assert best["ngspice"] == "pass"
        exact, simulated = best["settling_time"], best["ngspice_settling_time"]
        assert simulated == pytest.approx(exact, rel=0.02)
        written = load_scene(best["file"])
        assert verify(written.with_engine("statespace")).outcome.value == "pass"
    again = command(*words[:-3], "--json")
    assert "points: about" not in again.stderr  # all of them are stored
    assert json.loads(again.stdout)["designs"] == document["designs"]


def test_no_design_passes(tmp_path: Path) -> None:
    words = ["choose", FILE, "--settling", "1ns", "--opamps", "ne5534", "--points", "1"]
    found = command(*words, "--jobs", "1", "--store", str(tmp_path / "a.sqlite"))
    assert found.exit_code == 1
    assert "0 of 1 designs pass" in found.stdout


def test_a_board_without_a_capacitor_is_chosen_by_its_own_keys() -> None:
    found = taction.choose(ROOT / "scenes" / "ridge.toml", opamps="opa189", points=2, jobs=1)
    keys = ("design.feedback_conductance", "design.unit_conductance")
    assert {design.keys for design in found.designs} == {keys}
    assert len({tuple(design.values[key] for key in keys) for design in found.designs}) == 4


def test_a_worst_value_below_1_is_a_passing_scene(tmp_path: Path, rng: np.random.Generator) -> None:
    """Ten drawn designs; those of a failed check other than headroom do not pass."""
    design = {"lambda": 0.1, "gain": "30kohm", "unit_conductance": "30uS", "capacitance": "47pF"}
    checks = {"steady_state": {"tolerance": 0.02}, "overshoot": {"max": 0.05}}
    checks |= {"settling_time": {"band": 0.04, "max": "15us"}, "stability": {"margin": 1.5}}
    start = make_scene(
        {"kind": "matrix", "matrix": [[1.0, 0.3], [-0.2, 0.8]], "strain": [0.6, -0.4]},
        design=design | {"opamp": {"base": "opa189", "input_errors": "typical"}},
        checks=checks,
        analysis={"engine": "statespace"},
    )
    ranges = {CAPACITANCE: "20pF:300pF", GAIN: "20k:100k"}
    plan = choice_plan(start, ["opa189", "ua741"], ranges, 3)
    with Store(":memory:") as store:
        computed(plan, store, jobs=1)
        found = designs(plan, store)
    for each in found:
        if each.record.outcome != "pass":
            assert each.worst >= 1.0
            lacking = [name for name in each.record.failed if each.record.check(name).value is None]
            assert each.worst == float("inf") or not lacking  # such as: it never enters the band
    passed = []
    for rank, place in enumerate(rng.permutation(len(found))[:10]):
        each = found[place]
        written = tmp_path / f"{rank}.toml"
        written.write_text(scene_text(design_scene(plan, start, each, rank)), encoding="utf-8")
        verdict = verify(load_scene(written))
        passed.append(verdict.outcome is Outcome.PASS)
        if each.worst < 1.0:
            assert passed[-1], each.values
        elif set(each.record.failed) - {"headroom"}:
            # Beyond 90 % of an op-amp's limit the written board is simulated with the limit.
            assert not passed[-1], each.values
    assert 2 <= sum(passed) <= 8
