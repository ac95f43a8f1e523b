"""The summary of a sweep by two engines, its records and its files, from stored records."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.verification.report.documents.catalogue import sweep_pieces
from taction.verification.report.renderers.picture import draw_page
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.sweep import view
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.hybrid import sample
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.result import (
    SweepResult,
    dataset,
    export_sweep,
    grids,
    records,
)
from taction.verification.studies.sweep.run import SweepCounts
from tests.support.sweeping import grid_plan, make_record, reading, store_records

POINTS = 20  # of which 4 and 5 are next to the boundary
SAMPLE = sample(POINTS)[0]


def hybrid_plan() -> Plan:
    return grid_plan(f"C=1p:1n:{POINTS}", hybrid=True)


def hybrid_store(plan: Plan, **ngspice_at_4: Any) -> Store:
    """A store with both engines at every point; a hybrid sweep shows ngspice at some of them."""
    store, found = Store(":memory:"), {}
    for place in range(POINTS):
        stable = place > 4
        found["statespace", place] = make_record(stable=stable)
        attained = 1e-5 * (place + 1) if stable else None
        changes = {"stable": stable, "attained_error": attained}
        changes |= ngspice_at_4 if place == 5 else {}
        found["ngspice", place] = make_record("ngspice", **changes)
    store_records(plan, store, found)
    return store


def result_of(plan: Plan, store: Store) -> SweepResult:
    return SweepResult.of(plan, store, SweepCounts(plan.points))


def text_of(plan: Plan, store: Store) -> str:
    return page_text(view(result_of(plan, store)))


def document_of(result: SweepResult) -> Any:
    return json.loads("".join(sweep_pieces(result)))


def test_the_summary_counts_and_names_the_largest_difference() -> None:
    plan = hybrid_plan()
    with hybrid_store(plan) as store:
        found = result_of(plan, store).agreement
        rows = list(records(plan, store))
    # The first point has the least and greatest pole figures, 5 those of the stable points.
    chosen = {0: "extreme", SAMPLE: "sample"} | dict.fromkeys((4, 5), "boundary")
    assert found.points == found.agree == len(chosen)
    assert (found.disagree, found.undecided, found.listed) == (0, 0, [])
    assert found.chosen == {why: list(chosen.values()).count(why) for why in chosen.values()}
    last = max(place for place in chosen if place > 4)
    assert found.largest_difference == pytest.approx(1e-5 * (last + 1) / 2.5e-4)
    assert found.at == rows[-POINTS + last]["values"] or found.at is not None
    assert [row["engine"] for row in rows].count("ngspice") == len(chosen)
    assert {row["chosen"] for row in rows} == {None, *chosen.values()}
    assert all((row["agreement"] is None) == (row["chosen"] is None) for row in rows)


def test_a_disagreement_is_shown_everywhere() -> None:
    plan = hybrid_plan()
    with hybrid_store(plan, overshoot=reading(2.0, 1e-3)) as store:
        text = text_of(plan, store)
        result = result_of(plan, store)
        document = document_of(result)
        assert "the engines disagree at 1" in repr(result)
    assert "ngspice confirms 3 of 4 points (2 next to the stability boundary, 1 with an" in text
    assert "THE ENGINES DISAGREE at 1 point" in text
    assert "overshoot (step): 2 by ngspice, 1 by the state-space engine" in text
    assert document["agreement"]["disagree"] == 1
    listed = document["agreement"]["listed"]
    assert [point["disagreement"].partition(" ")[0] for point in listed] == ["overshoot"]


def test_a_point_without_a_verdict_is_not_confirmed() -> None:
    plan = hybrid_plan()
    with hybrid_store(plan, outcome="error", reason="timed out") as store:
        text = text_of(plan, store)
    assert "ngspice confirms 3 of 4 points" in text
    assert "1 not decided" in text
    assert "no verdict by ngspice: timed out" in text


def test_exports_have_ngspice_only_at_the_chosen_points(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    plan = hybrid_plan()
    with hybrid_store(plan) as store:
        result = result_of(plan, store)
        table, grid, arrays = result.to_pandas(), dataset(result), grids(result)
        export_sweep(result, str(tmp_path / "a.csv"))
        draw_page(view(result), tmp_path / "a.png")
    assert (table["engine"] == "statespace").sum() == POINTS
    assert (table["engine"] == "ngspice").sum() == 4
    assert table["agreement"].notna().sum() == 8  # both rows of a confirmed point say so
    with (tmp_path / "a.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == POINTS + 4
    assert [row["chosen"] for row in rows if row["engine"] == "ngspice"].count("boundary") == 2
    assert [float(row["difference"]) for row in rows if row["difference"]] == pytest.approx(
        [value for value in table["difference"] if not np.isnan(value)]
    )
    assert dict(grid.sizes) == {"C": POINTS, "engine": 2}
    confirmed = grid["outcome"].sel(engine="ngspice").values >= 0
    assert confirmed.sum() == np.isfinite(arrays["settling_time"][:, 0]).sum() == 4
    assert np.isfinite(grid["settling_time"].sel(engine="statespace").values).all()
    assert set(grid["agreement"].sel(engine="ngspice").values[confirmed].tolist()) == {0}


def test_a_sweep_by_one_engine_has_no_comparison() -> None:
    plan = grid_plan("C=1p:1n:3", engines=("statespace",))
    with Store(":memory:") as store:
        found = {("statespace", place): make_record() for place in range(3)}
        store_records(plan, store, found)
        assert [row["agreement"] for row in records(plan, store)] == [None] * 3
        assert result_of(plan, store).agreement is None
        assert document_of(result_of(plan, store))["agreement"] is None


def test_both_engines_at_every_point_are_compared() -> None:
    plan = grid_plan("C=1p:1n:3")
    with Store(":memory:") as store:
        found = {("statespace", place): make_record() for place in range(3)}
        found["ngspice", 1] = make_record("ngspice")
        store_records(plan, store, found)
        assert "ngspice confirms 1 of 1 points\n" in text_of(plan, store)
