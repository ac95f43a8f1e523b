"""Sweeps: nothing twice, failures as rows, the same by any way, and what they leave behind."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from taction.netlist_gen.scene.axes import parse_axes, with_values
from taction.netlist_gen.scene.scene import load_scene
from taction.system.documents import plain
from taction.system.errors import OutOfDisk, SimulationError, SimulatorNotFound
from taction.verification.studies.running import study
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import HERE, Workers
from taction.verification.studies.sweep import Plan, all_records, grid_points, sweep, sweep_points
from taction.verification.verdict import verify as module_of_verdicts
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify
from tests.support import nightly
from tests.support.making import make_scene, write_matrix_scene
from tests.support.paths import SCENES
from tests.support.running import taction as command
from tests.support.studying import DAMPED, IDEAL, one_thread

PAPER = SCENES / "paper-breadboard.toml"


@pytest.fixture
def workers() -> Iterator[Workers]:
    with one_thread() as found:
        yield found


def plan(*over: str, engine: str = "statespace", **tables: Any) -> Plan:
    asked = make_scene({"channels": 2, "span": 1.2}, **({"design": DAMPED} | tables))
    return Plan(asked, parse_axes(asked, over), engine)


Counts = tuple[int, Mapping[str, int]]


def run(asked: Plan, path: Path, workers: Workers, **more: Any) -> tuple[Counts, list[Any]]:
    with Store(str(path)) as store:
        count = sweep_points(asked, store, workers, **more)
        return count, list(all_records(asked, store))


def test_nothing_is_computed_twice(tmp_path: Path, workers: Workers) -> None:
    path = tmp_path / "a.sqlite"
    first, rows = run(plan("C=50p,100p"), path, workers)
    again, same = run(plan("C=50p,100p"), path, workers)
    assert (first[0], again[0], sum(again[1].values())) == (2, 0, 2)
    assert same == rows
    finer, _ = run(plan("C=50p,70p,100p"), path, workers)
    assert (finer[0], sum(finer[1].values())) == (1, 3)
    zipped, rows = run(plan("C=50p,100p gain=200k,100k"), path, workers)
    assert zipped[0] == 2
    values = [row["values"] for row in rows]
    assert values == [{"C": 50e-12, "gain": 2e5}, {"C": 100e-12, "gain": 1e5}]


def test_a_point_without_verdict_is_a_row(tmp_path: Path, workers: Workers) -> None:
    asked = plan("topology=passive,integrator", design=DAMPED | {"resistance": "100Mohm"})
    path = tmp_path / "a.sqlite"
    count, rows = run(asked, path, workers)
    assert [row["outcome"] for row in rows] == ["error", "pass"]
    assert rows[0]["failure"] == "InputError"
    assert "of the passive topology" in rows[0]["reason"]
    assert count[1] == {"error": 1, "pass": 1}
    again, _ = run(asked, path, workers)
    assert again[0] == 1


def test_an_unforeseen_error_is_a_row_and_is_retried(
    tmp_path: Path, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, path = plan("C=50p,100p"), tmp_path / "a.sqlite"
    with monkeypatch.context() as patch:
        patch.setattr(module_of_verdicts, "build", lambda *_, **__: 1 / 0)
        count, rows = run(asked, path, workers)
    assert count[1] == {"error": 2}
    assert rows[0]["failure"] == "ZeroDivisionError"
    assert "unforeseen: ZeroDivisionError" in rows[0]["reason"]
    count, rows = run(asked, path, workers)
    assert count[1] == {"pass": 2}
    assert rows[0]["failure"] is None


def test_what_counts_and_what_does_not(tmp_path: Path, workers: Workers) -> None:
    path = tmp_path / "a.sqlite"
    base = plan("C=50p")
    run(base, path, workers)

    def ran(tables: dict[str, Any]) -> int:
        return run(plan("C=50p", **tables), path, workers)[0][0]

    assert ran({"name": "another"}) == 0
    assert ran({"analysis": {"timeout": "5s"}}) == 0
    assert ran({"checks": {"settling_time": {"band": 0.02}}}) == 1
    assert ran({"analysis": {"initial": "rest"}}) == 1


def test_a_changed_file_is_another_problem(tmp_path: Path, workers: Workers) -> None:
    path = tmp_path / "a.sqlite"
    file = write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], IDEAL)
    asked = load_scene(file)
    sweep_of = Plan(asked, parse_axes(asked, ["C=50p"]), "statespace")
    assert [run(sweep_of, path, workers)[0][0] for _ in range(2)] == [1, 0]
    write_matrix_scene(tmp_path, [[1.0, 0.3], [0.2, 1.0]], [1.0, 0.5], IDEAL)
    assert run(sweep_of, path, workers)[0][0] == 1
    own = tmp_path / "own.opamp.json"
    opamp = asked.design.opamp.model_copy(update={"file": own.name})
    with_file = asked.design.model_copy(update={"opamp": opamp})
    other = replace(sweep_of, scene=asked.model_copy(update={"design": with_file}))
    keys = set()
    for content in ("a", "b"):
        own.write_text(content)
        keys |= {key for *_, key in grid_points(other)}
    assert len(keys) == 2


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


@pytest.mark.parametrize("engine", ["statespace", *nightly("ngspice")])
def test_no_point_of_a_sweep_depends_on_the_points_before(ngspice: str, engine: str) -> None:
    # Unstable, damped, ringing for long and for a few periods.
    forward = swept("C=8pF,1nF,12pF,100pF", engine)
    assert swept("C=100pF,12pF,1nF,8pF", engine) == forward
    assert len(forward) == 4
    base = load_scene(PAPER).with_engine(engine)
    for capacitance, record in forward.items():
        scene = with_values(base, {"design.capacitance": capacitance, "design.gain": 1e6})
        alone = json.loads(json.dumps(plain(Record.of(verify(scene), channels=False))))
        alone |= {"seconds": 0.0, "rightmost_pole": record["rightmost_pole"]}
        assert alone == record


def swept(over: str, engine: str) -> dict[float, dict[str, Any]]:
    """Return the records of a sweep of one worker by capacitance, without the time they took."""
    found = sweep(PAPER, over=over, engine=engine, fix="gain=1M", jobs=1).records()
    return {record.pop("values")["C"]: record | {"seconds": 0.0} for record in found}


OVER = ("--over", "C=50p:200p:3", "--over", "gain=50k,100k")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene, and a command line that computes in this process."""
    write_matrix_scene(tmp_path, [[1.0, 0.2], [0.2, 1.0]], [1.0, 0.5], IDEAL)
    monkeypatch.setattr(study, "local", lambda jobs: nullcontext(HERE))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def taction(*words: str) -> Result:
    return command("sweep", "scene.toml", "--engine", "statespace", *words)


def test_the_status_is_1_of_a_strict_sweep_that_fails_and_3_without_verdicts(folder: Path) -> None:
    failing = ("--over", "checks.steady_state.tolerance=1e-15,0.5", "-o", "a.sqlite")
    assert taction(*failing).exit_code == 0
    done = taction(*failing, "--strict")
    assert done.exit_code == 1, done.output
    assert "1 pass, 1 fail" in done.stdout
    assert taction("--over", "checks.steady_state.tolerance=0.4,0.5", "--strict").exit_code == 0
    done = taction("--over", "R=100M,200M", "--fix", "topology=passive")
    assert done.exit_code == 3, done.output
    assert "the same command computes the points without a verdict" in done.stdout


def test_an_export_has_every_number_exactly(folder: Path) -> None:
    done = taction(*OVER, "--export", "a.csv", "--json")
    rows = list(csv.DictReader((folder / "a.csv").read_text().splitlines()))
    points = json.loads(done.stdout)["points"]
    assert len(rows) == len(points) == 6
    for row, point in zip(rows, points, strict=True):
        assert float(row["C"]) == point["values"]["C"]
        assert float(row["settling_time"]) == point["settling_time"]
        assert row["margin"] == ""
        assert (row["outcome"], row["stable"]) == ("pass", "True")
    pandas = pytest.importorskip("pandas")
    taction(*OVER, "--export", "a.parquet")
    table = pandas.read_parquet(folder / "a.parquet")
    assert table["settling_time"].tolist() == [point["settling_time"] for point in points]
    assert table["stable"].tolist() == [True] * 6
