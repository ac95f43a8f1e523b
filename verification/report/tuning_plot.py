"""The trade-off of a tuning: settling time over overshoot. matplotlib is imported where used."""

from __future__ import annotations

from netlist_gen.quantities import show
from verification.report.verdict.plots import STYLE, save
from verification.studies.tune import Tuning


def plot_tradeoff(tuning: Tuning, path: str) -> None:
    """Draw the frontier, the limit, and the design before and after.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7, 5), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        overshoots = [100 * c.overshoot for c in tuning.frontier]
        times = [c.settling_time for c in tuning.frontier]
        axes.plot(overshoots, times, "o-", ms=4, label="no other design tried beats these")
        axes.axvline(100 * tuning.overshoot_limit, color="k", ls=":", label="overshoot limit")
        for name, candidate, mark in (("before", tuning.before, "s"), ("after", tuning.after, "*")):
            label = f"{name}: {show(candidate.settling_time, 's')}"
            axes.plot(100 * candidate.overshoot, candidate.settling_time, mark, ms=12, label=label)
        axes.set(xlabel="overshoot (% of the step)", ylabel="settling time (s)", yscale="log")
        axes.margins(0.08)
        axes.set_title(f"{tuning.scene.name}: settling time against overshoot")
        axes.legend(fontsize="small")
        save(figure, path)
