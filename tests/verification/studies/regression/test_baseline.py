"""The baseline: what it keeps of a verdict, its file, and a folder of scenes against it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from taction.netlist_gen.scene.check_keys import Regression
from taction.netlist_gen.scene.scene import load_scene
from taction.system.errors import InputError, Interrupted
from taction.verification.studies.regression import regress as module
from taction.verification.studies.regression.regress import (
    INTERRUPTED,
    Entry,
    RegressionReport,
    SceneResult,
    Status,
    baseline_text,
    compare_entry,
    keys_of,
    load_baseline,
    observe,
    regress,
    updated_baseline,
)
from taction.verification.verdict.record import Difference
from taction.verification.verdict.verify import verify
from tests.support.entries import channel, entry, write_fast


def test_a_baseline_is_read_as_it_was_written(tmp_path: Path) -> None:
    entries = {
        "b.toml": entry(name="b", curves=[["0 1e-6", "0 1"]]),
        "a.toml": entry(alternatives={"settling_time": None}),
    }
    file = tmp_path / "baseline.json"
    file.write_text(baseline_text(entries))
    assert load_baseline(file) == entries
    assert baseline_text(dict(reversed(entries.items()))) == baseline_text(entries)


def broken(change: dict[str, Any]) -> str:
    document = json.loads(baseline_text({"a.toml": entry()}))
    document["scenes"]["a.toml"] |= change
    return json.dumps(document)


WRONG = {
    "": "damaged, no JSON",
    "[" * 100_000: "damaged, no JSON",
    "[1, 2]": "no baseline of taction",
    '{"scenes": {}}': "no baseline of taction",
    '{"taction_baseline": 1, "scenes": {}}': "taction_baseline = 1: another format",
    '{"taction_baseline": 6}': "scenes = null: damaged",
    broken({"step_amplitude": "much"}): r"scenes\.a\.toml\.step_amplitude = 'much': damaged",
    broken({"step_amplitude": float("nan")}): r"scenes\.a\.toml\.step_amplitude = nan: damaged",
    broken({"growth_rate": None}): "growth_rate",
    broken({"curves": [["0 1e-6", "0"]]}): "expected as many outputs as instants",
    broken({"curves": [["0", "much"]]}): "damaged",
    broken({"surprise": 1}): "scenes: damaged: has a key that no baseline has",
}


@pytest.mark.parametrize("text", WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_with_a_file_is_said_and_what_to_do(tmp_path: Path, text: str) -> None:
    file = tmp_path / "baseline.json"
    file.write_text(text)
    with pytest.raises(InputError, match=WRONG[text]) as caught:
        load_baseline(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(("name", "says"), [("none.json", "`--update` writes"), ("", "regular")])
def test_what_is_no_file_is_named(tmp_path: Path, name: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_baseline(tmp_path / name)


def test_of_an_unstable_board_no_transient_is_compared(tmp_path: Path) -> None:
    scene = load_scene(write_fast(tmp_path / "fast.toml", capacitance="1pF"))
    entry = observe(verify(scene))
    assert entry.record.outcome == "fail"
    assert entry.record.value("growth_rate") > 0  # type: ignore[operator]
    found = compare_entry(entry, entry, Regression())
    assert {each.name for each in found if each.group == "channels"} == {"reference"}
    assert "settling_time" not in {each.name for each in found if each.group == "figures"}


def test_the_keys_are_of_what_was_asked_not_of_how_it_was_written(tmp_path: Path) -> None:
    def of(**changes: str) -> dict[str, str]:
        return keys_of(load_scene(write_fast(tmp_path / "s.toml", **changes)))

    def with_entry(entry: str) -> dict[str, str]:
        text = f"[problem]\nkind = 'matrix'\nmatrix = [[{entry}]]\nstrain = [1.0]\n"
        (tmp_path / "a.toml").write_text(text)
        return keys_of(load_scene(tmp_path / "a.toml"))

    same = of()
    assert of(capacitance="1e-11") == same
    assert of(more="# a comment\n[regression]\ntimes = { relative = 0.5 }\n") == same
    other = of(capacitance="11pF")
    assert other == same | {"design.capacitance": "11pF"}
    assert with_entry("2.0") == with_entry("2")
    assert with_entry("2.0") != with_entry("2.5")


def find(found: tuple[Difference, ...], name: str, group: str = "") -> Difference:
    return next(d for d in found if d.name == name and group in ("", d.group))


def against(
    now: dict[str, Any], allowed: dict[str, Any] | None = None, **then: Any
) -> tuple[Difference, ...]:
    table = Regression.model_validate(allowed or {})
    return compare_entry(entry(**now), entry(**then), table)


def test_an_entry_is_off_by_its_distance_over_absolute_plus_relative() -> None:
    found = against({})
    assert not any(d.beyond for d in found)
    assert {d.group for d in found} == {"checks", "states", "channels", "figures"}
    assert max(d.off for d in found) == 0.0
    now, then = channel(final=1.01, overshoot=0.26), channel(final=1.0, overshoot=0.25)
    allowed = {"levels": {"relative": 0.01, "absolute": 0.001}}
    found = against({"channels": [now]}, allowed, channels=[then], step_amplitude=2.0)
    final, overshoot = find(found, "final"), find(found, "overshoot")
    assert final.allowed == pytest.approx(0.001 * 2.0 + 0.01)  # of the step, V
    assert final.off == pytest.approx(0.01 / 0.012)
    assert overshoot.allowed == pytest.approx(0.001 + 0.01 * 0.25)  # in steps already
    assert overshoot.off == pytest.approx(0.01 / 0.0035)
    assert (final.beyond, overshoot.beyond) == (False, True)
    assert (final.unit, overshoot.unit) == ("V", "step")
    found = against({"growth_rate": -0.5}, growth_rate=-1e-3, frequency=1e6 / math.tau)
    growth = find(found, "growth_rate")
    assert growth.allowed == pytest.approx(1e-6 * 1e6 + 1e-3 * 1e-3)
    assert growth.off == pytest.approx(0.499 / 1.000001)


@pytest.mark.parametrize(
    ("now", "then", "off"),
    [
        ([1.01e-5], [1e-5], 0.5),
        ([1.03e-5], [1e-5], 1.5),
        ([8.78e-6], [1e-5, 8.78e-6], 0.0),  # a hair decided the other way
        ([1e-5, 8.78e-6], [8.78e-6], 0.0),
        ([None], [1e-5, None], 0.0),
        ([None], [1e-5], math.inf),
        ([1e-5], [None], math.inf),
    ],
)
def test_of_a_fragile_time_the_nearest_value_counts(
    now: list[float | None], then: list[float | None], off: float
) -> None:
    found = against(settling(now), **settling(then))
    assert find(found, "settling_time").off == pytest.approx(off)


def settling(values: list[float | None]) -> dict[str, Any]:
    """A settling time; a second value makes it fragile."""
    others = {"settling_time": values[-1]} if len(values) > 1 else {}
    return {"settling_time": values[0], "alternatives": others}


def test_of_a_board_that_became_unstable_only_poles_states_and_checks_are_compared() -> None:
    rings = {"index": 1, "state": "oscillating", "reference": 1.0}
    grown = {"growth_rate": 1e4, "frequency": 0.0, "settling_time": None}
    found = against(grown | {"channels": [rings]})
    assert {d.group for d in found if d.beyond} == {"states", "figures"}
    assert {d.group for d in found} == {"checks", "states", "figures"}


def run(
    folder: Path, baseline: dict[str, Entry] | None = None, *, update: bool = False
) -> RegressionReport:
    file = folder.with_suffix(".json")
    file.write_text(baseline_text(baseline or {}), encoding="utf-8")
    try:
        return regress(folder, baseline=file, update=update, jobs=1)
    except Interrupted as end:
        report: RegressionReport = end.result
        return report


def only(report: RegressionReport) -> SceneResult:
    (result,) = report.results
    return result


def stored(folder: Path, **scene: str) -> dict[str, Entry]:
    """The baseline of a folder of one scene, whatever its checks say."""
    return {"a.toml": observe(verify(load_scene(write_fast(folder / "a.toml", **scene))))}


@pytest.fixture(scope="module")
def passing(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Entry]:
    return stored(tmp_path_factory.mktemp("passing"))


@pytest.mark.parametrize(
    ("scene", "before", "status", "exit_status"),
    [
        ({}, None, Status.NEW, 0),  # judged by its checks
        ({"limit": "1us"}, None, Status.NEW, 1),
        ({}, {}, Status.SAME, 0),
        ({"capacitance": "10.5pF"}, {}, Status.CHANGED, 1),
        ({"limit": "1us"}, {}, Status.BROKEN, 1),
        ({"limit": "1us"}, {"limit": "1us"}, Status.FAILING, 1),
        ({}, {"limit": "1us"}, Status.NEWLY_PASSING, 0),
    ],
)
def test_a_scene_is_told_from_what_it_was(
    scene: dict[str, str], before: dict[str, str] | None, status: Status, exit_status: int,
    tmp_path: Path,
) -> None:  # fmt: skip
    baseline = {} if before is None else stored(tmp_path, **before)
    write_fast(tmp_path / "a.toml", **scene)
    report = run(tmp_path, baseline)
    found = only(report)
    assert (found.status, report.exit_status) == (status, exit_status)
    if status is Status.SAME:
        assert found.worst < 1e-5
        assert found.notes == ()
    if status is Status.CHANGED:
        edited = "edited since the baseline: design.capacitance was 10pF, now 10.5pF"
        assert found.notes[0] == edited
        assert {"figures", "channels"} <= {d.group for d in found.changes}
        off = [d.off for d in found.changes]
        assert off == sorted(off, reverse=True)
    if status is Status.BROKEN:
        assert [d.name for d in found.changes] == ["settling_time"]  # the check, nothing else


def test_a_scene_is_missing_until_an_update(tmp_path: Path, passing: dict[str, Entry]) -> None:
    write_fast(tmp_path / "b.toml")
    report = run(tmp_path, passing)
    assert report.count() == {"new": 1, "missing": 1}
    assert report.exit_status == 1
    accepted = run(tmp_path, passing, update=True)
    assert accepted.exit_status == 0
    assert set(updated_baseline(accepted, passing)) == {"b.toml"}


def test_a_file_that_is_no_scene_is_a_complaint_and_the_others_are_verified(
    tmp_path: Path, passing: dict[str, Entry]
) -> None:
    write_fast(tmp_path / "a.toml")
    (tmp_path / "pyproject.toml").write_text("[tool]\n")
    report = run(tmp_path, passing, update=True)
    assert [r.status for r in report.results] == [Status.SAME, Status.BAD_INPUT]
    assert "pyproject.toml" in report.results[1].reason
    assert report.exit_status == 2
    assert updated_baseline(report, passing) == passing


@pytest.mark.parametrize("name", ["empty", "none"])
def test_a_folder_without_scenes_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=name):
        run(tmp_path / name)


def test_an_update_accepts_no_failed_check(tmp_path: Path, passing: dict[str, Entry]) -> None:
    write_fast(tmp_path / "a.toml", capacitance="10.5pF")
    report = run(tmp_path, passing, update=True)
    assert (only(report).status, report.exit_status) == (Status.CHANGED, 0)
    assert only(run(tmp_path, updated_baseline(report, passing))).status is Status.SAME
    write_fast(tmp_path / "a.toml", limit="1us")
    report = run(tmp_path, passing, update=True)
    assert report.exit_status == 1
    assert updated_baseline(report, passing) == passing
    assert updated_baseline(report, {}) == {}
    assert "Not stored, a check fails: a.toml." in report.page().lines


def test_an_entry_within_its_tolerances_stays(tmp_path: Path, passing: dict[str, Entry]) -> None:
    """So small changes cannot add up, and the file has no needless difference."""
    write_fast(tmp_path / "a.toml")
    older = {"a.toml": replace(passing["a.toml"], taction="older")}
    kept = updated_baseline(run(tmp_path, older, update=True), older)
    assert baseline_text(kept) == baseline_text(older)
    write_fast(tmp_path / "a.toml", capacitance="10.001pF")  # the same numbers, another scene
    renewed = updated_baseline(run(tmp_path, older, update=True), older)
    assert renewed["a.toml"].taction != "older"


def test_a_baseline_without_curves_gets_them(tmp_path: Path, passing: dict[str, Entry]) -> None:
    write_fast(tmp_path / "a.toml")
    older = {"a.toml": replace(passing["a.toml"], curves=None)}
    report = run(tmp_path, older, update=True)
    assert only(report).status is Status.SAME
    assert updated_baseline(report, older) == passing
    ((_, u), *_), channel = passing["a.toml"].curves or (), passing["a.toml"].record.channels[0]
    assert float(u.split()[-1]) == pytest.approx(channel.figures["final"], rel=1e-3)


def test_ctrl_c_keeps_what_was_done(
    tmp_path: Path, passing: dict[str, Entry], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "abc":
        write_fast(tmp_path / f"{name}.toml", capacitance="10.5pF")
    judge = module.compare_scene

    def interrupted(path: Path, then: Entry | None) -> SceneResult:
        if path.name == "b.toml":
            raise KeyboardInterrupt
        return judge(path, then)

    monkeypatch.setattr(module, "compare_scene", interrupted)
    old = passing | {"c.toml": passing["a.toml"]}
    report = run(tmp_path, old, update=True)
    assert [r.status for r in report.results] == [Status.CHANGED, Status.NOT_RUN, Status.NOT_RUN]
    assert report.interrupted
    assert report.exit_status == INTERRUPTED
    kept = updated_baseline(report, old)
    assert load_baseline(tmp_path.with_suffix(".json")) == kept
    assert set(kept) == {"a.toml", "c.toml"}
    assert kept["c.toml"] == old["c.toml"]
    assert kept["a.toml"] != old["a.toml"]
