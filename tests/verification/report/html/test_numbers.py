"""The numbers of a page: those of the JSON document, as an engineer writes them."""

from __future__ import annotations

import re

import pytest

import taction
from taction.netlist_gen.scene.axes import parse_axes, with_values
from taction.verification.report.html.blocks import Picture
from taction.verification.report.html.sweep_maps import Plane, Ruler
from taction.verification.studies.sweep.boundary import Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan
from tests.support.making import make_scene
from tests.support.report_pages import STATESPACE, page
from tests.support.sweeping import grid_plan

PREFIXES = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
NUMBER = re.compile(r"^(-?[\d.]+)(?: ([pnµmkMG]?)(s|V|/s|F|Ω|A|Hz)?)?(?: (%))?(?: |$)")
ODD = re.compile(r"\d[eE][-+]?\d|\d [zaf](V|s|A)\b")  # 2.4e-13 %, 27.8 aV


def _pictures(name: str) -> list[Picture]:
    return [each for each in page(name).blocks() if isinstance(each, Picture)]


def test_three_axes_are_maps_at_each_value_of_the_third() -> None:
    found = _pictures("sweep, three axes")
    assert [each.title for each in found] == ["Outcome", "Settling time"] * 2
    places = ["1 pF"] * 2 + ["9 pF"] * 2
    for each, place in zip(found, places, strict=True):
        assert each.result.endswith(f"at stray_capacitance = {place}")


def test_the_boundary_is_a_mark_across_each_category() -> None:
    plan = grid_plan("opamp.base=ua741,op27", "C=10pF:100pF:3")
    rulers = [Ruler(group[0]) for group in plan.groups]
    plane = Plane(rulers[0], rulers[1], Boundary(points=((0, 5e-12), (1, 2e-11))))
    ends = [(line["x0"], line["x1"], line["y0"], line["y1"]) for line in plane.lines]
    assert ends == [(-0.5, 0.5, 5e-12, 5e-12), (0.5, 1.5, 2e-11, 2e-11)]


def test_the_boundary_of_a_map_is_the_crossing_of_onset() -> None:
    scene = make_scene({"channels": 3, "span": 2.0}, analysis=STATESPACE)
    axes = parse_axes(scene, ("C=1pF:100pF:9", "gain=5Mohm:8Mohm:2"))
    plan = Plan(scene, axes, ("statespace",), hybrid=False)
    across, down = (Ruler(group[0]) for group in plan.groups)
    lines = Plane(across, down, solve_boundary(plan)).lines
    gain = plan.groups[1][0].values[0]
    ends = [(line[f"x{k}"], line[f"y{k}"]) for line in lines for k in (0, 1)]
    drawn = {x for x, y in ends if y == pytest.approx(gain)}
    onset = taction.onset(
        with_values(scene, {"design.gain": gain}), over="C=1pF:100pF", transients=False
    )
    solved = [each.crossing.value for each in onset.findings if each.crossing.changes_stability]
    assert solved
    assert sorted(drawn) == pytest.approx(sorted(solved), rel=2e-3)


def test_what_fails_is_told_apart_by_colour_and_mark() -> None:
    traces = _pictures("sweep, a map")[0].spec["data"]
    looks = [(trace["marker"]["color"], trace["marker"]["symbol"]) for trace in traces]
    assert {trace["name"].partition(":")[0] for trace in traces} == {
        "pass", "fail", "inconclusive", "error",
    }  # fmt: skip
    assert len(set(looks)) == len(looks)
