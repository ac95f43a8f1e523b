"""Picture of a tuning: settling time against overshoot."""

from __future__ import annotations

from netlist_gen.quantities import show
from verification.report.picture import figure_file
from verification.studies.tune import Tuning


def plot_tradeoff(tuning: Tuning, path: str) -> None:
    """Draw the frontier, the limit, and the design before and after.

    Raises
    ------
    InputError
        See `verification.report.picture.figure_file`.
    """
    with figure_file(path, 7, 5) as figure:
        axes = figure.add_subplot()
        overshoots = [100 * c.overshoot for c in tuning.frontier]
        times = [c.settling_time for c in tuning.frontier]
        axes.plot(overshoots, times, "o-", ms=4, label="no other design tried is better than these")
        axes.axvline(100 * tuning.overshoot_limit, color="k", ls=":", label="overshoot limit")
        for name, candidate, mark in (("before", tuning.before, "s"), ("after", tuning.after, "*")):
            label = f"{name}: {show(candidate.settling_time, 's')}"
            axes.plot(100 * candidate.overshoot, candidate.settling_time, mark, ms=12, label=label)
        axes.set(xlabel="overshoot (% of the step)", ylabel="settling time (s)", yscale="log")
        axes.margins(0.08)
        axes.set_title(f"{tuning.scene.name}: settling time against overshoot")
        axes.legend(fontsize="small")
