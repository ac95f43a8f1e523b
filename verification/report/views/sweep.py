"""A sweep: maps over two axes, curves over one, small maps over three; engines; points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taction.netlist_gen.scene import axes
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.picture import check_plot_file
from taction.system.plugins import OpenTable
from taction.system.quantities import readable
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.blocks import (
    EVERYWHERE,
    NOTEBOOK,
    TERMINAL,
    Block,
    Cell,
    Facts,
    Notes,
    Page,
    Section,
    Shares,
    Sheet,
    Table,
    cell,
)
from taction.verification.report.charts import (
    OUTCOMES,
    Axis,
    Band,
    Cells,
    Chart,
    Curve,
    Grid,
    Look,
    Mark,
    looks_of,
    segments,
    zero_lines,
)
from taction.verification.report.texts import (
    LEAST_SHARE,
    counted,
    figure,
    number_cell,
    outcome_cell,
    quantity,
    spaced,
    titled,
)
from taction.verification.report.views.origin import origin_section
from taction.verification.studies.sweep.boundary import Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.result import (
    WORDS,
    AgreementSummary,
    SweepResult,
    all_records,
    grids,
)
from taction.verification.verdict.record import FIGURES

LISTED, LINES = 500, 40  # points in the table of a page, and of a terminal
MAPPED = 40_000  # points of the maps of a page
MOST_AXES = 3
MOST_MAPS = 6  # small maps beside each other
MOST_MARKS = 2500  # points above which marks of the other engine would overlap
COLUMNS = ("settling_time", *EXCURSIONS, "growth_rate", "frequency")
SHOWN = ("settling_time", *EXCURSIONS, "steady_state_error", "growth_rate")
LOGARITHMIC = ("settling_time", "steady_state_error")
ENGINES = OpenTable(
    "taction.engines", {"ngspice": "ngspice", "statespace": "state space"}, str, "title"
)
"""Names of the engines for people."""
Names = np.ndarray[Any, Any]


def columns_of(scene: Scene) -> tuple[str, ...]:
    """Return the figures in the table of a sweep: `COLUMNS`, and the noise if it has a limit."""
    return COLUMNS if scene.checks.noise is None else (*COLUMNS, "noise")


def view(result: SweepResult) -> Page:
    """Return what a sweep shows: the stored points of its plan."""
    plan, count, path = result.plan, result.count, result.store.path
    names = " x ".join(f"{each.name} ({len(each)})" for each in plan.axes)
    shares = tuple((n, count.outcomes[n]) for n in OUTCOMES if count.outcomes.get(n))
    outcomes = ", ".join(f"{number} {name}" for name, number in shares)
    foot = [f"{count.ran} computed now, {count.done - count.ran} from {path}"]
    if count.outcomes["error"]:
        foot.append("--retry failed computes the points without a verdict (error) again")
    return Page(
        title=plan.scene.name,
        command="taction sweep",
        summary=f"{count.done} of {count.total} points: {outcomes}.",
        lines=(f"Over {names}; engines: {', '.join(map(ENGINES.__getitem__, plan.engines))}.",),
        sections=(
            Section("Outcomes", (Shares("", shares),), media=(NOTEBOOK,)),
            Section("Axes", (Facts("", tuple(_axes(plan))),), media=(NOTEBOOK,)),
            Section("Pictures", lambda: _charts(result)),
            Section("Points", lambda: _listed(result), media=(TERMINAL,)),
            Section("Engines", lambda: _engines(result), media=EVERYWHERE),
            Section("Points", lambda: (_points(result),)),
            origin_section(plan.scene, (("database", path),)),
        ),
        foot=tuple(foot),
        sheet=lambda: _sheet(result),
    )


def check_sweep_plot(plan: Plan, path: str | Path | None) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        More than three axes, or see `taction.system.picture.check_plot_file`.
    """
    if path is not None:
        check_plot_file(path)
    if len(plan.groups) > MOST_AXES:
        text = f"{len(plan.groups)} axes; a picture has at most three, --export writes all of them"
        raise InputError("--plot", Complaint("FILE", repr(path and str(path)), text))


def result_names(result: SweepResult) -> Names:
    """Return what each point and engine says, as words over the grid, the engine last.

    ``"pass"``, ``"fail: stability"``, ``"inconclusive: rise time"``, ``"error: TimedOut"``; empty
    for a point without a result. Of several checks the first one counts, stability before all.
    """
    shape = (*result.plan.shape, len(result.plan.engines))
    found = [_name(record) if record else "" for record in all_records(result.plan, result.store)]
    names = np.empty(len(found), dtype=object)
    names[:] = found
    return names.reshape(shape)


def _name(record: dict[str, Any]) -> str:
    outcome: str = record["outcome"]
    if outcome == "error":
        return f"error: {record['failure']}"
    found = [check["name"] for check in record["checks"] if check["outcome"] == outcome]
    if outcome == "pass" or not found:
        return outcome
    return f"{outcome}: {spaced('stability' if 'stability' in found else found[0])}"


def _axes(plan: Plan) -> Iterator[tuple[str, str]]:
    for each in plan.axes:
        first, last = (_place(each, each.values[k]) for k in (0, -1))
        ends = first if len(each) == 1 else f"{first} to {last}"
        yield each.name, f"{counted(len(each), 'value')}, {ends}"


def _place(where: axes.SweepAxis, value: Any) -> str:
    return quantity(value, where.key.unit) if isinstance(value, float) else str(value)


def _axis(where: axes.SweepAxis) -> tuple[Axis, Floats]:
    """Return an axis of a chart and the places of its values; words stand one after the other."""
    if where.key.kind == "choice" or where.scale == "list":
        names = tuple(_place(where, value) for value in where.values)
        return Axis(where.name, scale="names", names=names), np.arange(float(len(names)))
    places = np.array([float(value) for value in where.values])
    log = where.scale == "log" and places.min() > 0.0
    return Axis(where.name, where.key.unit, "log" if log else "linear"), places


def _data(result: SweepResult) -> tuple[dict[str, Any], Names]:
    """Return the figures and the results over the grid.

    An excursion of a growing record depends on its length, and has no value.
    """
    data, names = grids(result), result_names(result)
    for name in EXCURSIONS:
        data[name][data["growth_rate"] > 0.0] = np.nan
    return data, names


def _worth(data: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return the quantities with a chart, and in words those too small for one."""
    little = [
        name
        for name in SHOWN
        if FIGURES[name].unit == "step" and np.nanmax(data[name], initial=0.0) < LEAST_SHARE
    ]
    return [name for name in SHOWN if name not in little], [spaced(name) for name in little]


def _charts(result: SweepResult) -> Iterator[Block]:
    plan = result.plan
    if len(plan.groups) > MOST_AXES:
        text = f"{len(plan.groups)} axes: pictures have at most {MOST_AXES}; --export writes all."
        yield Notes("", (text,))
        return
    if plan.points > MAPPED:
        yield Notes("", (f"{plan.points} points are too many for this page; see --plot.",))
        return
    data, names = _data(result)
    if len(plan.groups) == MOST_AXES:
        yield from itertools.chain.from_iterable(_multiples(plan, data, names))
        return
    shown, little = _worth(data)
    yield from _one_or_two(plan, data, names, shown)
    if little:
        yield Notes("", (f"Under 1 ppm of the step at every point: {', '.join(little)}.",))


def _one_or_two(
    plan: Plan, data: dict[str, Any], names: Names, shown: Sequence[str]
) -> Iterator[Chart]:
    """Yield the outcome and the quantities over one or two axes."""
    looks = looks_of(names.ravel().tolist())
    if len(plan.groups) == 1:
        for name in shown:
            yield _curve(plan, name, data, names, looks)
        return
    plane = Plane(plan, solve_boundary(plan), "", data["growth_rate"][..., -1])
    yield plane.outcomes(names, looks)
    for name in shown:
        yield plane.quantity(name, data[name][..., -1])


def _multiples(plan: Plan, data: dict[str, Any], names: Names) -> Iterator[tuple[Chart, Chart]]:
    """Yield what fails and the settling time over two axes, for values of the third."""
    third, looks = plan.groups[2][0], looks_of(names.ravel().tolist())
    places = chosen_places(len(third))
    shared = data[SHOWN[0]][:, :, places, -1]
    known = shared[np.isfinite(shared)]
    limits = (float(known.min()), float(known.max())) if len(known) else None
    for k in places:
        where = f" at {third.name} = {_place(third, third.values[k])}"
        plane = Plane(plan, boundary_at(plan, k), where, data["growth_rate"][:, :, k, -1])
        values = data[SHOWN[0]][:, :, k, -1]
        yield plane.outcomes(names[:, :, k], looks), plane.quantity(SHOWN[0], values, limits)


def chosen_places(count: int) -> list[int]:
    """Return the places of the values of the third axis that have a map: first, last, between."""
    places = np.linspace(0, count - 1, min(count, MOST_MAPS)).round()
    return [int(place) for place in np.unique(places)]


def boundary_at(plan: Plan, number: int) -> Boundary:
    """Solve the stability boundary at a value of the third axis, by its place."""
    changes = {axis.key.path: axis.values[number] for axis in plan.groups[2]}
    scene = with_values(plan.scene, changes)
    return solve_boundary(Plan(scene, plan.groups[:2], plan.engines))


class Plane:
    """The first two axes of a plan, and the stability boundary over them.

    Parameters
    ----------
    plan : Plan
        With two axes or more.
    boundary : Boundary
        Over the first two.
    where : str
        Where the plane is among other axes: ``" at stray_capacitance = 1 pF"``.
    growth : ndarray (n, m) or None
        Growth rates, 1/s, between which an unsolved boundary is interpolated.
    """

    def __init__(
        self, plan: Plan, boundary: Boundary, where: str = "", growth: Floats | None = None
    ) -> None:
        (self.x, self.across), (self.y, self.down) = (_axis(g[0]) for g in plan.groups[:2])
        self.engines, self.boundary, self.where = plan.engines, boundary, where
        self.growth = growth

    @property
    def edge(self) -> Curve | None:
        """The boundary; across a category it is a mark, and categories are not joined."""
        ends: list[Any] = list(self.boundary.segments)
        if self.boundary.unsolved and self.growth is not None:
            ends = list(zero_lines(self.across, self.down, self.growth.T))
        elif not ends:
            for x, y in self.boundary.points:
                whole = ((x - 0.5, y), (x + 0.5, y))
                ends.append(whole if self.x.scale == "names" else ((x, y - 0.5), (x, y + 0.5)))
        return Curve(*segments(ends), "", "ink", width=2.5, label="") if ends else None

    @property
    def note(self) -> str:
        """What the thick line is, for the caption."""
        if self.boundary.unsolved:
            what = "No stability boundary" if self.edge is None else "Thick line: interpolated"
            return f" {what}, since {self.boundary.unsolved}."
        if self.edge is None:
            return " Stability does not change within this map."
        return (
            " Thick line: stability boundary, solved between the points (a pole crosses the"
            " imaginary axis)."
        )

    def outcomes(self, names: Names, looks: dict[str, Look]) -> Chart:
        """Return what each point says; `names` has the engine last."""
        last = names[..., -1].T
        marks: list[Mark] = [Cells(self.across, self.down, last, looks)]
        summary = (
            "The result of every point. Of several checks that fail the first one is shown,"
            f" stability before all others.{self.note}"
        )
        if len(self.engines) > 1 and last.size <= MOST_MARKS:
            marks += self._other(names[..., 0].T)
            own, other = (ENGINES[self.engines[k]] for k in (-1, 0))
            summary += f" Cells: verdicts of {own}; small marks: {other}."
        marks += [self.edge] if self.edge is not None else []
        passing, total = int((last == "pass").sum()), int((last != "").sum())
        verb = "passes" if passing == 1 else "pass"
        message = f"{passing} of {total} points {verb}{self.where}"
        return Chart("Outcome", self.x, self.y, tuple(marks), message, summary, (), "below", 440)

    def _other(self, names: Names) -> Iterator[Curve]:
        """Yield the outcomes of the first engine as marks on the cells."""
        engine = ENGINES[self.engines[0]]
        for outcome, look in OUTCOMES.items():
            there = np.array([[n.startswith(outcome) for n in row] for row in names], np.bool_)
            rows, columns = np.nonzero(there)
            if len(rows):
                x, y = self.across[columns], self.down[rows]
                yield Curve(x, y, f"{engine}: {outcome}", "ink", "", look.mark, size=4.0)

    def quantity(
        self, name: str, values: Floats, limits: tuple[float, float] | None = None
    ) -> Chart:
        """Return the values (n, m) of a quantity as colours."""
        unit, signed = FIGURES[name].unit, name == "growth_rate"
        scale = "signed" if signed else "log" if name in LOGARITHMIC else "linear"
        heat = Grid(
            self.across, self.down, values.T, unit, scale,  # type: ignore[arg-type]
            limits=limits, warm="positive",
        )  # fmt: skip
        colours = " The strongest colour is the largest value."
        if signed:
            colours = " Blue decays, orange grows."
        summary = (
            f"{titled(name)} over {self.x.title} and {self.y.title}.{colours} Empty: no value."
            f"{self.note}"
        )
        marks = (heat,) if self.edge is None else (heat, self.edge)
        message = f"{extent(values, unit)}{self.where}"
        return Chart(titled(name), self.x, self.y, marks, message, summary, (), "", 400)


def extent(values: Floats, unit: str) -> str:
    """Return the smallest and the largest value in words."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "no point has a value"
    low, high = (figure(float(end), unit, 3) for end in (known.min(), known.max()))
    return low if low == high else f"{low} to {high}"


def _curve(
    plan: Plan, name: str, data: dict[str, Any], names: Names, looks: dict[str, Look]
) -> Chart:
    """Return a quantity over one axis; the mark is the result of the point."""
    unit, values = FIGURES[name].unit, data[name]
    x, places = _axis(plan.groups[0][0])
    marks: list[Mark] = list(_unstable(data["growth_rate"], places))
    for k, engine in enumerate(plan.engines):
        if x.scale != "names":
            marks.append(Curve(places, values[..., k], "", "muted", width=0.8, behind=True))
        for kind, look in looks.items():
            there = names[..., k] == kind
            if there.any():
                label = f"{kind}, {ENGINES[engine]}" if len(plan.engines) > 1 else kind
                hover = tuple(figure(v, unit) for v in values[..., k][there].tolist())
                marks.append(
                    Curve(places[there], values[..., k][there], label, look.colour, "", look.mark,
                          size=7.0 - 3.0 * k, hover=hover)
                )  # fmt: skip
    known = np.abs(values[np.isfinite(values)])
    wide = len(known) and known.min() > 0.0 and known.max() > 10.0 * known.min()
    log = wide and name != "growth_rate"
    limits = None
    if log and unit == "step":  # below `LEAST_SHARE` lies rounding
        limits = (max(float(known.min()), LEAST_SHARE) * 0.8, float(known.max()) * 1.25)
    y = Axis(spaced(name), unit, "log" if log else "linear", limits)
    summary = f"{titled(name)} over {x.title}; the mark is the result of the point."
    return Chart(
        titled(name), x, y, tuple(marks), extent(values, unit), summary, (), "below", 340
    )  # fmt: skip


def _unstable(growth: Floats, places: Floats) -> Iterator[Band]:
    """Yield the parts of an axis whose points are unstable by their poles."""
    grows = np.nanmax(growth, axis=-1, initial=-np.inf) > 0.0
    between = 0.5 * (places[1:] + places[:-1])
    edges = [places[0], *between, places[-1]]
    for _, run in itertools.groupby(enumerate(grows.tolist()), key=lambda pair: pair[1]):
        own = list(run)
        if own[0][1]:
            low, high = edges[own[0][0]], edges[own[-1][0] + 1]
            yield Band(float(low), float(high), "x", "unstable by its poles", "fail", hatched=True)


def _sheet(result: SweepResult) -> Sheet:
    """Return the picture: all quantities and the outcome, or small maps over three axes."""
    plan = result.plan
    check_sweep_plot(plan, None)
    data, names = _data(result)
    passing = int((names[..., -1] == "pass").sum())
    engines = " and ".join(ENGINES[engine] for engine in plan.engines)
    title = f"{plan.scene.name}: {passing} of {plan.points} points pass, {engines}"
    foot = "grey: no value"
    if len(plan.groups) == MOST_AXES:
        columns = tuple(_multiples(plan, data, names))
        return Sheet(title, columns, size=(4.2 + 4.4 * len(columns), 8.2), foot=foot)
    shown, little = _worth(data)
    drawn = list(_one_or_two(plan, data, names, shown))
    if len(plan.groups) == 2:
        foot = f"{drawn[0].summary.partition('all others. ')[2]} Grey: no value."
    text = Notes("", (f"Under 1 ppm of the step: {', '.join(little)}.",))
    blocks: list[Block] = [*drawn, *[text] * bool(little)]
    return Sheet.of(title, blocks, 3, (6.0, 0.0), (0.0, 8.6), foot)


def _engines(result: SweepResult) -> Iterator[Block]:
    """Yield how far two engines agree, and every disagreement."""
    plan, found = result.plan, result.agreement
    if found is None:
        return
    yield Notes("", tuple(_agreement(plan, found)))
    if found.disagree:
        text = f"THE ENGINES DISAGREE at {counted(found.disagree, 'point')}"
        yield Notes("", (text,), "fail")
    listed = (
        f"{record['agreement']} at {_places(plan, record['values'])}: {record['disagreement']}"
        for record in found.listed
    )
    yield Notes("", tuple(listed))


def _agreement(plan: Plan, found: AgreementSummary) -> Iterator[str]:
    reasons = ", ".join(f"{found.chosen[why]} {WORDS[why]}" for why in WORDS if why in found.chosen)
    text = f"ngspice confirms {found.agree} of {found.points} points"
    yield f"{text} ({reasons})" if reasons else text
    if found.largest_difference is not None and found.at is not None:
        yield (
            f"largest difference of the engines: {found.largest_difference:.2g} of the error that"
            f" the checks allow, at {_places(plan, found.at)}"
        )
    if found.undecided:
        yield f"{found.undecided} not decided"


def _places(plan: Plan, values: Mapping[str, Value]) -> str:
    return ", ".join(f"{a.name} = {_place(a, values[a.name])}" for a in plan.axes)


def _listed(result: SweepResult) -> Iterator[Block]:
    """Yield the points of a small sweep, else those without a verdict, and their reasons."""
    whole = result.count.total <= LINES
    wanted = (r for r in result.records() if whole or r["outcome"] == "error")
    shown = list(itertools.islice(wanted, LINES))
    yield _table(result.plan, "", shown, engine=len(result.plan.engines) > 1).folded()
    yield Notes("", tuple(_reasons(result.plan, shown)))


def _reasons(plan: Plan, shown: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each thing that is wrong at some points: how many, and the first of them.

    The values of all of them stand in the table; the reasons of points without a verdict do not,
    so each of these has its line.
    """
    alike: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for record in shown:
        reason = record["reason"].split("\n")[0][:160]
        if reason:
            name = _name(record)
            kind = reason if record["outcome"] == "error" else ""
            alike.setdefault((name, kind), []).append({**record, "reason": reason})
    for (name, _), records in alike.items():
        first = records[0]
        place = f"{_places(plan, first['values'])}, {first['engine']}: {first['reason']}"
        yield place if len(records) == 1 else f"{len(records)} {name}, such as {place}"


def _points(result: SweepResult) -> Table:
    listed = list(itertools.islice(result.records(), LISTED))
    several = len(result.plan.engines) > 1
    made = _table(result.plan, "Points", listed, engine=several, why=True)
    more = result.count.total > LISTED
    return replace(made, note=f"The first {LISTED} points; --export writes all." * more)


def _table(
    plan: Plan, title: str, listed: Sequence[dict[str, Any]], *, engine: bool, why: bool = False
) -> Table:
    figures = columns_of(plan.scene)
    several, last = ("engine",) * engine, ("why",) * why
    titles = (*(a.name for a in plan.axes), *several, "outcome", *map(spaced, figures), *last)
    rows = (
        (
            *(_value(record["values"][each.name], each) for each in plan.axes),
            *(record[name] for name in several),
            outcome_cell(record["outcome"]),
            *(number_cell(record[name], FIGURES[name].unit) for name in figures),
            *(_why(record) for _ in last),
        )
        for record in listed
    )
    cells = tuple(tuple(map(cell, row)) for row in rows)
    return Table(title, titles, cells, heads=len(plan.axes) + engine)


def _why(record: dict[str, Any]) -> str:
    """Return the first line of the reason, with the check in words."""
    name, colon, rest = record["reason"].split("\n")[0].partition(":")
    return readable(f"{spaced(name) if name.isidentifier() else name}{colon}{rest}")


def _value(value: Any, where: axes.SweepAxis) -> Cell:
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return Cell(quantity(float(value), where.key.unit), float(value))
    return Cell(str(value))
