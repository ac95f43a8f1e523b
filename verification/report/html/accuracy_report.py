"""The report of a work-precision study: error against run time, orders, cheapest settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from taction.system.quantities import readable
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Notes,
    Picture,
    Report,
    Section,
    Table,
)
from taction.verification.report.html.pictures import (
    DASHES,
    MARKS,
    SERIES,
    axis,
    line,
    numbers,
    words,
)
from taction.verification.report.html.sections.origin import origin_section
from taction.verification.report.html.texts import number_cell, quantity
from taction.verification.report.work_precision.tables import PROBLEMS, accuracy_document
from taction.verification.studies.work_precision.study import WorkPrecisionStudy

LOWEST = 1e-15  # place of an error of exactly 0


def accuracy_report(study: WorkPrecisionStudy) -> Report:
    """Return the report of a work-precision study."""
    document = accuracy_document(study)
    best = [each for each in document["cheapest"] if each["any"]]
    summary = "No run of this study has a known error."
    if best:
        last = best[-1]
        method = last["any"]["method"]
        summary = (
            f"{method[:1].upper()}{method[1:]} reaches an error of {last['error']:.0e} of the step"
            f" in {quantity(last['any']['seconds'], 's', 3)}."
        )
    sections = [
        Section(f"Error against run time: {PROBLEMS[name]}", tuple(_problem(document, name)))
        for name in document["problems"]
    ]
    return Report(
        title=study.scene.name,
        command="taction accuracy",
        outcome="",
        summary=summary,
        lines=(study.extent.text,),
        sections=(
            *sections,
            Section("Cheapest settings", (_cheapest(document),)),
            Section("Order of convergence", (_orders(document),)),
            *(
                [Section("Left out", (Notes("", tuple(study.omissions)),))]
                if study.omissions
                else []
            ),
            origin_section(study.scene, (("the study took", quantity(study.seconds, "s", 3)),)),
        ),
    )


def _methods(document: dict[str, Any], problem: str) -> list[dict[str, Any]]:
    return [method for method in document["methods"] if method["problem"] == problem]


def _known(method: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        point
        for point in method["points"]
        if point["errors"]["maximum"] is not None and point["seconds"] is not None
    ]


def _problem(document: dict[str, Any], problem: str) -> Iterator[Block]:
    methods = _methods(document, problem)
    count = sum(len(_known(method)) for method in methods)
    if count > 1:
        yield _picture(document, problem)
    else:
        text = f"{count or 'No'} run has a known error: there is nothing to compare."
        yield Notes("", (f"{text} A larger --budget gives more runs.",))
    rows = tuple(
        (
            Cell(method["name"]),
            Cell("–" if point["setting"] is None else f"{point['setting']:g}", point["setting"]),
            Cell(point["status"]),
            number_cell(point["seconds"], "s", 3),
            _error(point["errors"]["maximum"]),
            _error(point["errors"]["final"]),
            Cell("–" if point["steps"] is None else str(point["steps"]), point["steps"]),
            Cell(point["note"]),
        )
        for method in methods
        for point in method["points"]
    )
    titles = (
        "method",
        "setting",
        "status",
        "time",
        "largest error",
        "error at the end",
        "steps",
        "note",
    )
    yield Table("Runs", titles, rows, "Errors are fractions of the step.")


def _error(value: float | None) -> Cell:
    return Cell("–") if value is None else Cell(f"{value:.2e}", value)


def _picture(document: dict[str, Any], problem: str) -> Picture:
    data = []
    for k, method in enumerate(_methods(document, problem)):
        points = _known(method)
        name, colour = words(method["name"]), SERIES[k % len(SERIES)]
        data.append(
            {"type": "scatter", "mode": "lines+markers", "name": name,
             "x": numbers([point["seconds"] for point in points]),
             "y": numbers([max(point["errors"]["maximum"], LOWEST) for point in points]),
             "text": ["" if p["setting"] is None else f"setting {p['setting']:g}" for p in points],
             "line": {"color": colour, "dash": DASHES[k // len(SERIES) % len(DASHES)]},
             "marker": {"symbol": MARKS[k % len(MARKS)], "size": 9},
             "hovertemplate": f"{name} %{{text}}: error %{{y:.2e}} in %{{x:.3s}}s<extra></extra>"}
        )  # fmt: skip
    floor = document["problems"][problem]["reference_error"]["maximum"]
    layout = {
        "xaxis": axis("wall time", "s", type="log", dtick=1),
        "yaxis": axis("largest error (of the step)", type="log", exponentformat="power", dtick=2),
        "shapes": [line(None, floor, "--muted", dash="dash")] if floor else [],
        "hovermode": "closest",
    }
    summary = (
        "Each mark is one setting of a method: further left is faster, further down is more"
        " accurate. The dashed line is the error of the reference."
    )
    spec, result = {"data": data, "layout": layout}, _best(document, problem)
    return Picture("Runs by time and error", spec, summary, 460, result=result)


def _best(document: dict[str, Any], problem: str) -> str:
    """Return the most accurate run in words."""
    runs = [
        (p["errors"]["maximum"], p["seconds"], m["name"])
        for m in _methods(document, problem)
        for p in _known(m)
    ]
    error, seconds, name = min(runs)
    return f"the most accurate is {name}, {error:.1e} in {quantity(seconds, 's', 3)}"


def _cheapest(document: dict[str, Any]) -> Table:
    rows = tuple(
        (
            Cell(f"{each['error']:.0e}", each["error"]),
            *_choice(each["any"]),
            *_choice(each["ngspice"]),
        )
        for each in document["cheapest"]
    )
    titles = ("largest error", "cheapest", "time", "ngspice", "time of ngspice")
    return Table("Cheapest setting that reaches an error", titles, rows)


def _choice(found: dict[str, Any] | None) -> tuple[Cell, Cell]:
    if found is None:
        return Cell("no run reached it"), Cell("–")
    setting = "" if found["setting"] is None else f", setting {found['setting']:g}"
    return Cell(f"{found['method']}{setting}"), number_cell(found["seconds"], "s", 3)


def _orders(document: dict[str, Any]) -> Table:
    rows = tuple(
        (
            Cell(method["name"]),
            Cell("–")
            if method["order"] is None
            else Cell(
                f"{method['order']:.2f} ± {method['order_uncertainty']:.2f}", method["order"]
            ),
            Cell(str(method["order_theory_says"])),
            Cell(readable(method["order_reason"])),
        )
        for method in document["methods"]
    )
    return Table(
        "Order of the largest error against the mean step",
        ("method", "fitted", "theory", "left out"),
        rows,
    )
