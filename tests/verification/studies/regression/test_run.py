"""A folder of scenes against its baseline: what became of each, and what is kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from taction.system.errors import InputError, Interrupted
from taction.verification.studies.regression import regress as module
from taction.verification.studies.regression.baseline import Entry, baseline_text
from taction.verification.studies.regression.regress import (
    INTERRUPTED,
    RegressionReport,
    SceneResult,
    Status,
    regress,
    updated_baseline,
)
from tests.support.entries import write_fast


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


def entries(folder: Path) -> dict[str, Entry]:
    return updated_baseline(run(folder, update=True), {})


def only(report: RegressionReport) -> SceneResult:
    (result,) = report.results
    return result


@pytest.fixture(scope="module")
def passing(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Entry]:
    folder = tmp_path_factory.mktemp("passing")
    write_fast(folder / "a.toml")
    return entries(folder)


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Entry]:
    folder = tmp_path_factory.mktemp("failing")
    write_fast(folder / "a.toml", limit="1us")
    entry = only(run(folder)).entry
    assert entry is not None
    return {"a.toml": entry}


def test_a_scene_without_baseline_is_new_and_judged_by_its_checks(tmp_path: Path) -> None:
    write_fast(tmp_path / "a.toml")
    assert (only(run(tmp_path)).status, run(tmp_path).exit_status) == (Status.NEW, 0)
    write_fast(tmp_path / "a.toml", limit="1us")
    assert (only(run(tmp_path)).status, run(tmp_path).exit_status) == (Status.NEW, 1)


def test_the_same_scene_is_the_same(tmp_path: Path, passing: dict[str, Entry]) -> None:
    write_fast(tmp_path / "a.toml")
    report = run(tmp_path, passing)
    assert (only(report).status, report.exit_status) == (Status.SAME, 0)
    assert only(report).worst < 1e-5
    assert only(report).notes == ()


def test_a_scene_that_passes_otherwise_is_changed(
    tmp_path: Path, passing: dict[str, Entry]
) -> None:
    write_fast(tmp_path / "a.toml", capacitance="10.5pF")
    report = run(tmp_path, passing)
    assert (only(report).status, report.exit_status) == (Status.CHANGED, 1)
    assert only(report).notes[0] == "edited: capacitance 10pF → 10.5pF"
    assert {"figures", "channels"} <= {d.group for d in only(report).changes}
    assert [d.off for d in only(report).changes] == sorted(
        (d.off for d in only(report).changes), reverse=True
    )


def test_broken_still_failing_and_newly_passing_are_told_apart(
    tmp_path: Path, passing: dict[str, Entry], failing: dict[str, Entry]
) -> None:
    write_fast(tmp_path / "a.toml", limit="1us")
    report = run(tmp_path, passing)
    assert (only(report).status, report.exit_status) == (Status.BROKEN, 1)
    assert [d.name for d in only(report).changes] == ["settling_time"]  # the check, nothing else
    report = run(tmp_path, failing)
    assert (only(report).status, report.exit_status) == (Status.FAILING, 1)
    write_fast(tmp_path / "a.toml")
    report = run(tmp_path, failing)
    assert (only(report).status, report.exit_status) == (Status.NEWLY_PASSING, 0)


def test_a_scene_that_is_gone_is_missing_until_the_baseline_is_updated(
    tmp_path: Path, passing: dict[str, Entry]
) -> None:
    write_fast(tmp_path / "b.toml")
    report = run(tmp_path, passing)
    assert report.count() == {"new": 1, "missing": 1}
    assert report.exit_status == 1
    accepted = run(tmp_path, passing, update=True)
    assert accepted.exit_status == 0
    assert set(updated_baseline(accepted, passing)) == {"b.toml"}


def test_without_an_engine_there_is_no_verdict_and_the_entry_stays(
    tmp_path: Path, passing: dict[str, Entry], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "no-such-ngspice")
    scene = write_fast(tmp_path / "a.toml")
    scene.write_text(scene.read_text().replace("statespace", "ngspice"))
    report = run(tmp_path, passing, update=True)
    assert (only(report).status, report.exit_status) == (Status.NO_VERDICT, 3)
    assert "no-such-ngspice" in only(report).reason
    assert updated_baseline(report, passing) == passing


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


def test_an_update_accepts_a_change_but_not_a_failed_check(
    tmp_path: Path, passing: dict[str, Entry]
) -> None:
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


def test_an_entry_within_its_tolerances_stays_as_it_is(
    tmp_path: Path, passing: dict[str, Entry]
) -> None:
    """So small changes cannot add up, and the file has no needless difference."""
    write_fast(tmp_path / "a.toml")
    older = {"a.toml": replace(passing["a.toml"], taction="older")}
    kept = updated_baseline(run(tmp_path, older, update=True), older)
    assert baseline_text(kept) == baseline_text(older)
    write_fast(tmp_path / "a.toml", capacitance="10.001pF")  # the same numbers, another scene
    renewed = updated_baseline(run(tmp_path, older, update=True), older)
    assert renewed["a.toml"].taction != "older"


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
    assert set(kept) == {"a.toml", "c.toml"}
    assert kept["c.toml"] == old["c.toml"]
    assert kept["a.toml"] != old["a.toml"]
