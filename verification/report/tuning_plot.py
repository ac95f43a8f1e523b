"""Picture of a tuning: settling time against overshoot."""

from __future__ import annotations

import math
from typing import Any

from taction.system.quantities import readable, show
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuning
from taction.verification.report.picture import BLUE, GREY, ORANGE, figure_file
from taction.verification.report.verdict.remedies import value_text

ABOVE_RIGHT: dict[str, Any] = {"xytext": (8, 6), "textcoords": "offset points"}
BELOW_RIGHT: dict[str, Any] = {"xytext": (8, -12), "textcoords": "offset points"}


def plot_tradeoff(tuning: Tuning, path: str) -> None:
    """Draw the frontier, the limit, and the design before and after, with their values.

    The neighbours of the chosen design on the frontier have their values, too.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

    after = readable(show(tuning.after.settling_time, "s"))
    title = (
        f"{tuning.scene.name}: settled in {after}, overshoot {100 * tuning.after.overshoot:.3g} %"
    )
    with figure_file(path, 8.5, 5.5, title) as figure:
        axes = figure.add_subplot()
        frontier = sorted(tuning.frontier, key=lambda c: c.overshoot)
        x, y = [100 * c.overshoot for c in frontier], [c.settling_time for c in frontier]
        axes.plot(x, y, "o-", ms=4, color=GREY, label="no design tried is better than these")
        limit = 100 * tuning.overshoot_limit
        axes.axvline(limit, color="k", ls=":", label=f"overshoot limit, {limit:.3g} %")
        for name, candidate, mark, colour in (
            ("before", tuning.before, "s", ORANGE),
            ("after", tuning.after, "*", BLUE),
        ):
            label = f"{name}: {readable(show(candidate.settling_time, 's'))}"
            place = (100 * candidate.overshoot, candidate.settling_time)
            axes.plot(*place, mark, ms=12, color=colour, label=label)
            if all(map(math.isfinite, place)):
                text = _values(tuning, candidate)
                axes.annotate(text, place, fontsize="small", color=colour, **ABOVE_RIGHT)
        for candidate in _neighbours(frontier, tuning.after):
            place = (100 * candidate.overshoot, candidate.settling_time)
            text = _values(tuning, candidate)
            axes.annotate(text, place, fontsize="x-small", color="0.35", **BELOW_RIGHT)
        axes.set(xlabel="overshoot (% of the step)", ylabel="settling time", yscale="log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(EngFormatter("s"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.margins(0.18, 0.1)
        axes.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4)


def _values(tuning: Tuning, candidate: Trial) -> str:
    texts = (value_text(tuning.scene, p, v) for p, v in candidate.values.items())
    return readable(", ".join(texts))


def _neighbours(frontier: list[Trial], chosen: Trial) -> list[Trial]:
    """Return the designs of the frontier beside the chosen one."""
    if chosen not in frontier:
        return []
    place = frontier.index(chosen)
    return [frontier[k] for k in (place - 1, place + 1) if 0 <= k < len(frontier)]
