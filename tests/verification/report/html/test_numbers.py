"""The numbers of a page: those of the JSON document, as an engineer writes them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

import pytest

import taction
from taction.netlist_gen.scene.axes import parse_axes, with_values
from taction.verification.report.html.blocks import Bars, Picture, Report, Table
from taction.verification.report.html.sections.checks import headroom_section
from taction.verification.report.html.sweep_maps import Plane, Ruler
from taction.verification.report.verdict.json_document import verdict_document
from taction.verification.studies.sweep.boundary import Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan
from tests.support.making import make_scene
from tests.support.report_pages import STATESPACE, VERDICTS, page, verdicts
from tests.support.sweeping import grid_plan

PREFIXES = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
NUMBER = re.compile(r"^(-?[\d.]+)(?: ([pnµmkMG]?)(s|V|/s|F|Ω|A|Hz)?)?(?: (%))?(?: |$)")
ODD = re.compile(r"\d[eE][-+]?\d|\d [zaf](V|s|A)\b")  # 2.4e-13 %, 27.8 aV


def number(text: str) -> float:
    """Return the value of a text in SI units, a share of the step as a fraction."""
    found = NUMBER.match(text)
    assert found, text
    value = float(found[1]) * PREFIXES[found[2] or ""]
    return value / 100.0 if found[4] else value


def block(report: Report, kind: type[Table] | type[Bars], title: str) -> Table | Bars:
    blocks = itertools.chain.from_iterable(section.blocks for section in report.sections)
    return next(each for each in blocks if isinstance(each, kind) and each.title == title)


@pytest.mark.parametrize("name", VERDICTS)
def test_the_checks_have_the_numbers_of_the_document(name: str) -> None:
    document = verdict_document(verdicts()[name])
    bars = block(page(name), Bars, "")
    assert isinstance(bars, Bars)
    assert len(bars.rows) == len(document["checks"])
    for bar, check in zip(bars.rows, document["checks"], strict=True):
        assert bar.outcome == check["outcome"]
        if check["value"] is None:
            assert bar.value == "–"
        elif bar.value.startswith("under 1 ppm"):
            assert abs(check["value"]) < 1e-6
        else:
            assert number(bar.value) == pytest.approx(check["value"], rel=6e-3)


@pytest.mark.parametrize("name", VERDICTS)
def test_the_channels_have_the_numbers_of_the_document(name: str) -> None:
    records = verdict_document(verdicts()[name])["channels"]
    table = block(page(name), Table, "Channels")
    assert isinstance(table, Table)
    assert len(table.rows) == len(records)
    for row, record in zip(table.rows, records, strict=True):
        cells = dict(zip(table.columns, row, strict=True))
        for column, key in (("target", "reference"), ("end", "final")):
            assert cells[column].number == pytest.approx(record[key])
            assert number(cells[column].text) == pytest.approx(record[key], rel=6e-3, abs=1e-9)


def _texts(report: Report) -> Iterator[str]:
    for each in itertools.chain.from_iterable(section.blocks for section in report.sections):
        if isinstance(each, Bars):
            yield from (bar.value for bar in each.rows)
        elif isinstance(each, Table):
            yield from (cell.text for row in each.rows for cell in row[1:])
        elif isinstance(each, Picture):
            yield from (each.title, each.result)
            yield from map(str, each.spec["data"][0].get("text") or ())
    yield from (report.summary, *report.lines)


@pytest.mark.parametrize("name", VERDICTS)
def test_no_number_has_an_exponent_or_a_prefix_below_rounding(name: str) -> None:
    assert [text for text in _texts(page(name)) if ODD.search(text)] == []


@pytest.mark.parametrize(("limited", "outcome"), [(True, ""), (False, "fail")])
def test_a_load_above_a_simulated_limit_is_no_failure(limited: bool, outcome: str) -> None:
    load = {
        "part": "c_8", "quantity": "slope", "unit": "V/s", "peak": 1e7, "limit": 5e5,
        "share": 20.0, "time": 0.0, "error": None,
    }  # fmt: skip
    section = headroom_section([load], limited=limited)
    (bars,) = section.blocks
    assert isinstance(bars, Bars)
    assert bars.rows[0].outcome == outcome
    assert bars.rows[0].fill == "fail"
    assert ("without limits" in section.lead) == limited


def _pictures(name: str) -> list[Picture]:
    blocks = itertools.chain.from_iterable(section.blocks for section in page(name).sections)
    return [each for each in blocks if isinstance(each, Picture)]


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
