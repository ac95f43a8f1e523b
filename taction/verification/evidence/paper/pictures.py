"""Pictures of the reproduction: charts with one caption."""

from __future__ import annotations

from dataclasses import replace

from taction.system.charts import SERIES, Axis, Chart, Limit, Mark

Picture = tuple[Chart, ...]


def picture(caption: str, *charts: Chart) -> Picture:
    """Return charts with a caption that says what all of them show."""
    return tuple(replace(chart, summary=caption) for chart in charts)


def panel(title: str, x: Axis, y: Axis, *marks: Mark) -> Chart:
    """Return a chart of a picture; a legend of many names stands below it."""
    named = sum(bool(getattr(mark, "name", "")) for mark in marks)
    return Chart(title, x, y, marks, legend="inside" if named <= 2 else "below", height=330)


def level(value: float, text: str, colour: int = 1) -> Limit:
    """Return a labelled horizontal line in one of the colours of curves."""
    return Limit(value, "y", f"{text}: {value:.3g}", SERIES[colour], "dash")
