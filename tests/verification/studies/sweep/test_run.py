"""Sweeps: nothing twice, failures as rows, and the same by any way."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from taction.netlist_gen.scene.axes import parse_axes, with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import (
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
)
from taction.verification.stability import margin
from taction.verification.studies.running.pool import WorkerDiedError, Workers
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep.plan import (
    Plan,
    SweepCounts,
    sweep_points,
)
from taction.verification.studies.sweep.result import records
from taction.verification.verdict import verify as module_of_verdicts
from taction.verification.verdict.verify import verify
from tests.support.making import NEAR_IDEAL, make_scene, write_matrix_scene
from tests.support.paths import SCENES
from tests.support.studying import IDEAL

DAMPED = {"capacitance": "100pF", "gain": "100kohm", "stray_capacitance": 0.0, "opamp": NEAR_IDEAL}


@pytest.fixture
def workers() -> Iterator[Workers]:
    with ThreadPoolExecutor(1) as executor:
        yield Workers(executor, 1, spare=1)


def scene(**tables: Any) -> Scene:
    return make_scene({"channels": 2, "span": 1.2}, design=DAMPED, **tables)


def plan(*over: str, engine: str = "statespace") -> Plan:
    asked = scene()
    return Plan(asked, parse_axes(asked, over), engine)


def test_a_point_is_the_same_whatever_was_computed_before(
    tmp_path: Path, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Boards that differ in C alone share their edges; who found them must not show."""
    found = []
    board = load_scene(SCENES / "tuned-breadboard.toml")
    for number, values in enumerate(("230p", "500p,230p", "110p,230p")):
        monkeypatch.setattr(margin, "_SHARED", {})
        asked = Plan(board, parse_axes(board, f"C={values}"), "statespace")
        found.append(run(asked, tmp_path / f"{number}", workers)[1][-1] | {"seconds": None})
    assert found[0]["margin"] < 100.0
    assert found[0] == found[1] == found[2]


def run(asked: Plan, path: Path, workers: Workers, **more: Any) -> tuple[SweepCounts, list[Any]]:
    with Store(str(path)) as store:
        count = sweep_points(asked, store, workers, **more)
        return count, list(records(asked, store))


def test_every_point_is_the_verification_of_its_scene(tmp_path: Path, workers: Workers) -> None:
    asked = plan("C=50p,100p", "gain=50k:200k:2")
    count, rows = run(asked, tmp_path / "a.sqlite", workers)
    assert [row["values"] for row in rows] == [
        {"C": C, "gain": gain} for C in (50e-12, 100e-12) for gain in (5e4, 2e5)
    ]
    for row in rows:
        changes = {
            "design.capacitance": row["values"]["C"],
            "design.gain": row["values"]["gain"],
            "analysis.engine": "statespace",
        }
        verdict = verify(with_values(asked.scene, changes))
        # verify finds the root on the exact solution, a sweep interpolates its points.
        settled = verdict.measurements.settling_time.value
        assert row["settling_time"] == pytest.approx(settled, rel=1e-6)
        assert row["rightmost_pole"][0] == verdict.poles.rightmost.real
        assert row["outcome"] == verdict.outcome.value
        assert [check["name"] for check in row["checks"]] == [c.name for c in verdict.checks]
    assert (count.total, count.done, count.ran) == (4, 4, 4)


def test_nothing_is_computed_twice(tmp_path: Path, workers: Workers) -> None:
    path = tmp_path / "a.sqlite"
    first, rows = run(plan("C=50p,100p"), path, workers)
    again, same = run(plan("C=50p,100p"), path, workers)
    assert (first.ran, again.ran, again.done) == (2, 0, 2)
    assert same == rows
    finer, _ = run(plan("C=50p,70p,100p"), path, workers)
    assert (finer.ran, finer.done) == (1, 3)


def test_zipped_keys_change_together(tmp_path: Path, workers: Workers) -> None:
    count, rows = run(plan("C=50p,100p gain=200k,100k"), tmp_path / "a.sqlite", workers)
    assert count.total == 2
    assert [row["values"] for row in rows] == [
        {"C": 50e-12, "gain": 2e5},
        {"C": 100e-12, "gain": 1e5},
    ]


def test_a_point_without_verdict_is_a_row(tmp_path: Path, workers: Workers) -> None:
    board = make_scene({"channels": 2, "span": 1.2}, design=DAMPED | {"resistance": "100Mohm"})
    asked = Plan(board, parse_axes(board, ["topology=passive,integrator"]), "statespace")
    path = tmp_path / "a.sqlite"
    count, rows = run(asked, path, workers)
    assert [row["outcome"] for row in rows] == ["error", "pass"]
    assert rows[0]["failure"] == "InputError"
    assert "of the passive topology" in rows[0]["reason"]
    assert count.outcomes == {"error": 1, "pass": 1}
    again, _ = run(asked, path, workers)
    assert again.ran == 1


def test_an_unforeseen_error_is_a_row_and_is_retried(
    tmp_path: Path, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, path = plan("C=50p,100p"), tmp_path / "a.sqlite"
    with monkeypatch.context() as patch:
        patch.setattr(module_of_verdicts, "build", lambda *_, **__: 1 / 0)
        count, rows = run(asked, path, workers)
    assert count.outcomes == {"error": 2}
    assert rows[0]["failure"] == "ZeroDivisionError"
    count, rows = run(asked, path, workers)
    assert count.outcomes == {"pass": 2}
    assert rows[0]["failure"] is None


def test_what_counts_and_what_does_not(tmp_path: Path, workers: Workers) -> None:
    path = tmp_path / "a.sqlite"
    base = plan("C=50p")
    run(base, path, workers)

    def ran(tables: dict[str, Any]) -> int:
        asked = scene(**tables)
        return run(Plan(asked, parse_axes(asked, ["C=50p"]), "statespace"), path, workers)[0].ran

    assert ran({"name": "another"}) == 0
    assert ran({"analysis": {"timeout": "5s"}}) == 0
    assert ran({"checks": {"settling_time": {"band": 0.02}}}) == 1
    assert ran({"analysis": {"initial": "rest"}}) == 1


def test_a_changed_file_is_another_problem(tmp_path: Path, workers: Workers) -> None:
    path = tmp_path / "a.sqlite"
    design = IDEAL
    file = write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], design)
    asked = load_scene(file)
    sweep_of = Plan(asked, parse_axes(asked, ["C=50p"]), "statespace")
    assert [run(sweep_of, path, workers)[0].ran for _ in range(2)] == [1, 0]
    write_matrix_scene(tmp_path, [[1.0, 0.3], [0.2, 1.0]], [1.0, 0.5], design)
    assert run(sweep_of, path, workers)[0].ran == 1


def failing(error: Exception) -> Workers:
    """Workers of which every task ends with an error."""

    class Failing(ThreadPoolExecutor):
        def submit(self, *args: Any, **kwargs: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_exception(error)
            return future

    return Workers(Failing(1), 1)


def test_a_point_that_no_worker_survives_is_a_row(tmp_path: Path) -> None:
    workers = failing(WorkerDiedError("abrupt end"))
    count, rows = run(plan("C=50p,60p"), tmp_path / "a.sqlite", workers)
    assert count.outcomes == {"error": 2}
    assert rows[0]["failure"] == "WorkerDiedError"
    assert "killed" in rows[0]["reason"]


@pytest.mark.parametrize("kind", [OutOfDisk, SimulatorNotFound])
def test_what_is_wrong_with_the_machine_is_no_result_of_a_point(
    kind: type[SimulationError], workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*scene: object, **more: object) -> None:
        raise kind("there is nothing left")

    monkeypatch.setattr(module_of_verdicts, "build", fail)
    with Store(":memory:") as store:
        with pytest.raises(kind, match=r"nothing left\. The stored results are intact"):
            sweep_points(plan("C=50p,60p"), store, workers)
        assert store.count() == 0


def test_a_simulator_that_is_removed_is_no_result_of_a_point(
    workers: Workers, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, ngspice: str
) -> None:
    link = tmp_path / "ngspice"
    link.symlink_to(ngspice)
    monkeypatch.setenv("TACTION_NGSPICE", str(link))
    asked = plan("C=50p,60p", engine="ngspice")
    with Store(":memory:") as store:
        # The simulator goes before the first point is sent to a worker.
        with pytest.raises(SimulatorNotFound, match=f"no executable '{link}'"):
            sweep_points(asked, store, workers, progress=lambda text: link.unlink())
        assert store.count() == 0
