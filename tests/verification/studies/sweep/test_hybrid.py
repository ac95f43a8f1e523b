"""The points that ngspice confirms in a hybrid sweep."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.verification.studies.running.worker import Workers
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.hybrid import (
    BOUNDARY,
    EXTREME,
    SAMPLE,
    confirmed_points,
    next_to_the_boundary,
    sample,
)
from taction.verification.studies.sweep.plan import plan_sweep
from taction.verification.studies.sweep.result import records
from taction.verification.studies.sweep.run import SweepCounts, sweep
from tests.support.paths import SCENES
from tests.support.sweeping import grid_plan, make_record, store_records

PAPER, TUNED = (SCENES / f"{name}-breadboard.toml" for name in ("paper", "tuned"))
READINGS = {
    "settling_time",
    "rise_time",
    "overshoot",
    "undershoot",
    "end_error",
    "growth_rate",
    "frequency",
    "damping_ratio",
    "margin",
}


@pytest.fixture
def workers() -> Iterator[Workers]:
    with ThreadPoolExecutor(1) as executor:
        yield Workers(executor, lambda: 2, (BrokenExecutor,))


def chosen(stable: list[bool | None], **figures: list[float | None]) -> dict[int, str]:
    """The choice on one axis of C, from stored records of the state-space engine."""
    plan = grid_plan(f"C=1p:1n:{len(stable)}", hybrid=True)
    found = {}
    for place, known in enumerate(stable):
        values = {name: column[place] for name, column in figures.items()}
        outcome = "error" if known is None else "pass"
        found["statespace", place] = make_record(stable=known, outcome=outcome, **values)
    with Store(":memory:") as store:
        store_records(plan, store, found)
        return confirmed_points(plan, store)


def test_neighbours_of_another_stability_are_chosen() -> None:
    found = chosen([True] * 4 + [False] * 3 + [True] * 13)
    assert {place for place, why in found.items() if why == BOUNDARY} == {3, 4, 6, 7}


def test_a_point_without_verdict_is_no_neighbour() -> None:
    found = chosen([True] * 5 + [None] + [False] * 14)
    assert BOUNDARY not in found.values()


def test_the_first_point_with_the_least_and_the_greatest_reading_is_chosen() -> None:
    times = [5.0, 3.0, 3.0, 7.0, 7.0 + 1e-12, 4.0, None, 5.0]
    found = chosen([True] * 8, settling_time=[*times])
    # All other figures are equal at every point: their first point is the first of the grid.
    assert {place for place, why in found.items() if why == EXTREME} == {0, 1, 3}


def test_readings_of_growing_records_do_not_count_but_poles_do() -> None:
    stable = [False] * 3 + [True] * 17
    overshoot = [9.0, 0.0, 9.0, *[0.5] * 17]
    growth = [2.0, 3.0, 1.0, *[-1.0] * 17]
    rest = {name: [None] * 20 for name in ("frequency", "damping_ratio", "margin")}
    found = chosen(stable, overshoot=[*overshoot], growth_rate=[*growth], **rest)
    # Place 1 has the fastest growth; place 3 has the first of the equal readings.
    assert found == {1: EXTREME, 2: BOUNDARY, 3: BOUNDARY} | dict.fromkeys(
        set(sample(20)) - {1, 2, 3}, SAMPLE
    )


def test_the_sample_is_a_twentieth_and_always_the_same() -> None:
    assert [len(sample(points)) for points in (1, 20, 21, 651)] == [1, 1, 2, 33]
    places = sample(10_000)
    assert places == sample(10_000)
    assert len(set(places)) == 500
    assert max(places) < 10_000
    assert abs(np.mean(places) - 5000) < 5 * 10_000 / np.sqrt(12 * 500)
    assert SAMPLE in chosen([True] * 40).values()


def test_words_have_no_neighbours() -> None:
    plan = grid_plan("topology=integrator,passive", "C=1p,2p")
    signs = np.array([[1, 1], [-1, -1]])
    assert not next_to_the_boundary(signs, plan).any()
    assert next_to_the_boundary(signs.T, plan).all()


def documented(rows: list[dict[str, Any]], shape: tuple[int, int]) -> set[int]:
    """The points of docs/sweeps.md, found by comparing every pair of neighbours."""
    found = set(sample(len(rows)))
    cells = list(itertools.product(range(shape[0]), range(shape[1])))
    stable = dict(zip(cells, (row["stable"] for row in rows), strict=True))
    for place, (i, j) in enumerate(cells):
        around = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)]
        if any(stable[other] != stable[i, j] for other in around if other in stable):
            found.add(place)
    for name in READINGS:
        of_poles = name in ("growth_rate", "frequency", "damping_ratio", "margin")
        rounded = {
            place: float(f"{row[name]:.6g}")
            for place, row in enumerate(rows)
            if row[name] is not None and (row["stable"] or of_poles)
        }
        for extreme in (min, max):
            if rounded:
                best = extreme(rounded.values())
                found.add(min(place for place, value in rounded.items() if value == best))
    return found


def test_a_hybrid_sweep_runs_ngspice_at_the_documented_points_only(
    tmp_path: Path, workers: Workers, ngspice: str
) -> None:
    over = ["C=1pF:20pF:6", "gain=1M:8M:5"]
    plan = plan_sweep(TUNED, over, "hybrid", fix="lambda=0.7", keep_waveforms=False)
    with Store(str(tmp_path / "a.sqlite")) as store:
        count = sweep(plan, store, workers)
        rows = list(records(plan, store))
        exact = [row for row in rows if row["engine"] == "statespace"]
        confirmed = [row for row in rows if row["engine"] == "ngspice"]
        places = {id(row["values"]): place for place, row in enumerate(exact)}
        assert len(places) == 30
        at = [place for place, row in enumerate(exact) if row["chosen"] is not None]
        assert set(at) == documented(exact, (6, 5))
        assert [row["values"] for row in confirmed] == [exact[place]["values"] for place in at]
        assert len({row["stable"] for row in exact}) == 2
        assert store.count() == count.total == count.done == count.ran == 30 + len(at)
        assert all(row["simulator"].startswith("ngspice-") for row in confirmed)
        assert {row["agreement"] for row in confirmed} == {"pass"}
        assert {row["agreement"] for row in exact} == {"pass", None}
        differences = [row["difference"] for row in confirmed if row["stable"]]
        assert all(0.0 < difference <= 1.0 for difference in differences)
        again = sweep(plan, store, workers)
        assert (again.ran, again.done, again.outcomes) == (0, count.done, count.outcomes)


class StoppedError(Exception):
    """The end of a sweep by its user."""


@pytest.mark.parametrize("after", [3, 10])
def test_an_interrupted_hybrid_sweep_continues_with_the_same_points(
    tmp_path: Path, workers: Workers, ngspice: str, after: int
) -> None:
    plan = plan_sweep(PAPER, "C=20pF:200pF:8", "hybrid", fix="gain=1M", keep_waveforms=False)

    def stop(count: SweepCounts) -> None:
        if count.ran == after:
            raise StoppedError

    with Store(str(tmp_path / "a.sqlite")) as store, Store(":memory:") as whole:
        with pytest.raises(StoppedError):
            sweep(plan, store, workers, progress=stop)
        assert store.count() == after
        rest = sweep(plan, store, workers)
        once = sweep(plan, whole, workers)
        assert rest.ran == once.ran - after
        assert rest.total == once.total > 8
        chosen_points = confirmed_points(plan, store)
        assert chosen_points == confirmed_points(plan, whole)


def test_results_of_ngspice_elsewhere_are_not_shown(
    tmp_path: Path, workers: Workers, ngspice: str
) -> None:
    both = plan_sweep(PAPER, "C=50pF:200pF:6", "both", fix="gain=1M", keep_waveforms=False)
    hybrid = plan_sweep(PAPER, "C=50pF:200pF:6", "hybrid", fix="gain=1M", keep_waveforms=False)
    with Store(str(tmp_path / "a.sqlite")) as store:
        assert sweep(both, store, workers).ran == 12
        count = sweep(hybrid, store, workers)
        assert count.ran == 0
        assert 6 < count.total < 12
        assert len(list(records(hybrid, store))) == count.total
        assert len(list(records(both, store))) == 12
