"""What a sweep shows: maps, the stability boundary, results with their looks."""

from __future__ import annotations

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.axes import parse_axes, with_values
from taction.verification.report.charts import Cells, Chart
from taction.verification.report.views.sweep import Plane
from taction.verification.studies.sweep.boundary import Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan
from tests.support.making import make_scene
from tests.support.report_pages import STATESPACE, page
from tests.support.sweeping import grid_plan


def _charts(name: str) -> list[Chart]:
    return [each for each in page(name).blocks() if isinstance(each, Chart)]


def ends(plane: Plane) -> list[tuple[float, float, float, float]]:
    """Return the lines of the boundary: x and y of one end, x and y of the other."""
    assert plane.edge is not None
    x, y = (np.asarray(v).reshape(-1, 3)[:, :2] for v in (plane.edge.x, plane.edge.y))
    return [(*a, *b) for a, b in zip(x.tolist(), y.tolist(), strict=True)]


def test_three_axes_are_maps_at_each_value_of_the_third() -> None:
    found = _charts("sweep, three axes")
    assert [each.title for each in found] == ["Outcome", "Settling time"] * 2
    places = ["1 pF"] * 2 + ["9 pF"] * 2
    for each, place in zip(found, places, strict=True):
        assert each.message.endswith(f"at stray_capacitance = {place}")


def test_the_boundary_is_a_mark_across_each_category() -> None:
    plan = grid_plan("opamp.base=ua741,op27", "C=10pF:100pF:3")
    plane = Plane(plan, Boundary(points=((0, 5e-12), (1, 2e-11))))
    assert ends(plane) == [(-0.5, 0.5, 5e-12, 5e-12), (0.5, 1.5, 2e-11, 2e-11)]


def test_the_boundary_of_a_map_is_the_crossing_of_onset() -> None:
    scene = make_scene({"channels": 3, "span": 2.0}, analysis=STATESPACE)
    axes = parse_axes(scene, ("C=1pF:100pF:9", "gain=5Mohm:8Mohm:2"))
    plan = Plan(scene, axes, ("statespace",), hybrid=False)
    gain = plan.groups[1][0].values[0]
    lines = ends(Plane(plan, solve_boundary(plan)))
    both = [(x, y) for x0, x1, y0, y1 in lines for x, y in ((x0, y0), (x1, y1))]
    drawn = {x for x, y in both if y == pytest.approx(gain)}
    onset = taction.onset(
        with_values(scene, {"design.gain": gain}), over="C=1pF:100pF", transients=False
    )
    solved = [each.crossing.value for each in onset.findings if each.crossing.changes_stability]
    assert solved
    assert sorted(drawn) == pytest.approx(sorted(solved), rel=2e-3)


def test_what_fails_is_told_apart_by_colour_and_mark() -> None:
    (cells,) = (mark for mark in _charts("sweep, a map")[0].marks if isinstance(mark, Cells))
    kinds = {name.partition(":")[0] for name in cells.looks}
    assert kinds == {"pass", "fail", "inconclusive", "error"}
    looks = [(look.colour, look.mark) for look in cells.looks.values()]
    assert len(set(looks)) == len(looks)
