"""Jobs that verify or analyse a scene many times: onset, sweep, Monte Carlo."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taction.netlist_gen.scene.axes import Over
    from taction.netlist_gen.scene.fixed import Fixed
    from taction.netlist_gen.scene.scene import Scene
    from taction.results import Onset, YieldReport
    from taction.verification.report.sweep.result import SweepResult
    from taction.verification.studies.sweep.plan import Plan
    from taction.verification.verdict.clock import Progress


def onset(
    scene: str | Path | Scene,
    *,
    over: Over,
    transients: bool = True,
    progress: Progress = lambda stage: None,
) -> Onset:
    """Find every value on an axis at which a scene's board begins or ceases to oscillate.

    Parameters
    ----------
    scene : path or Scene
        The board.
    over : mapping, str or iterable of str
        The axis: ``{"C": ("2pF", "20pF", 13)}`` (lowest, highest, number of points), as on the
        command line (``"C=2pF:20pF:13"``), or a key alone: from 1/30 to 30 times its own value.
    transients : bool
        Confirm each crossing by transients of ngspice on both sides.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Onset
        `findings` holds the crossings of the poles, each with its frequency and its confirmation;
        `plot` draws the poles.

    Raises
    ------
    InputError
        The scene or the axis cannot be used.
    NoVerdictError
        No value on the axis gives a board whose poles can be computed.

    Examples
    --------
    >>> import taction
    >>> onset = taction.onset(
    ...     "scenes/paper-breadboard.toml", over={"C": ("5pF", "20pF", 13)}, transients=False
    ... )
    >>> print(f"stable from {onset.findings[-1].crossing.value:.3g} F")
    stable from 9.02e-12 F
    """
    from taction.results import Onset
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.studies.onset.onset import onset as find_crossings
    from taction.verification.studies.onset.onset import parse_onset_axis

    scene = read_scene(scene)
    axis = parse_onset_axis(scene, over)
    return Onset.of(find_crossings(scene, axis, transients=transients, progress=progress))


def sweep(
    scene: str | Path | Scene,
    *,
    over: Over,
    engine: str | None = None,
    fix: Fixed = (),
    keep_waveforms: bool = False,
    retry_failed: bool = False,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> SweepResult:
    """Verify a scene at every point of a grid; a point without a verdict has its reason.

    In a script, call it below ``if __name__ == "__main__":``, since its processes import the
    script.

    Parameters
    ----------
    scene : path or Scene
        The scene whose values change.
    over : mapping, str or iterable of str
        The axes by key: a tuple ``("1pF", "1nF", 31)`` is a range of 31 points with logarithmic
        spacing (``("1pF", "1nF", 31, "lin")``: linear), a list holds the values. Strings are read
        as on the command line (``"C=1pF:1nF:31"``).
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"`` in the place of the scene's own engine;
        ``"both"`` engines at every point; or ``"hybrid"``: the state-space engine at every point,
        and ngspice next to the stability boundary, at the extremes of every reading and at a
        random sample of 5 %.
    fix : mapping, str or iterable of str
        Keys that keep one value at every point: ``"lambda"`` for the scene's own value, also where
        the scene gives a resistance; ``{"lambda": 0.5}`` or ``"lambda=0.5"`` for another value.
    keep_waveforms : bool
        Store the outputs over time.
    retry_failed : bool
        Compute points without a verdict again.
    output : path, optional
        A database (``.sqlite``); points that it holds are not computed again. By default the
        points stay in memory.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler, ``"tcp://host:port"``, that runs the points.
    progress : callable, optional
        Receives a line with the estimated time before the first point is computed, then the
        number of finished points with the remaining time.

    Returns
    -------
    SweepResult
        `to_pandas`, `to_xarray`, `plot` and `records` give the points, `agreement` how far two
        engines agree.

    Raises
    ------
    InputError
        The scene, an axis or the database cannot be used.
    NoVerdictError
        A point needs ngspice and ngspice is missing, or the cluster is gone.

    Examples
    --------
    >>> import taction
    >>> result = taction.sweep(
    ...     "scenes/paper-breadboard.toml",
    ...     over={"C": ("8pF", "20pF", 2), "opamp.base": ["ideal", "ua741"]},
    ...     engine="statespace",
    ...     jobs=1,
    ... )
    >>> result
    SweepResult('paper-breadboard', C x opamp.base: 4 points, 3 fail, 1 pass)
    >>> result.to_pandas()["stable"].tolist()
    [False, True, True, True]
    """
    from taction.verification.report.sweep.result import SweepResult
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.store import Store
    from taction.verification.studies.sweep.run import sweep as run

    plan = plan_sweep(scene, over, engine, fix=fix, keep_waveforms=keep_waveforms)
    store = Store(":memory:" if output is None else str(output))
    with workers_at(cluster, jobs, progress) as workers:
        count = run(
            plan,
            store,
            workers,
            retry_failed=retry_failed,
            progress=lambda count: progress(count.text),
            announce=progress,
        )
    return SweepResult.of(plan, store, count)


def plan_sweep(
    scene: str | Path | Scene,
    over: Over,
    engine: str | None,
    *,
    fix: Fixed = (),
    keep_waveforms: bool,
) -> Plan:
    """Return the grid of a sweep; arguments and errors are those of `sweep`."""
    from taction.netlist_gen.scene.axes import parse_axes, with_values
    from taction.netlist_gen.scene.fixed import check_axes, fixed_values
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.studies.sweep.plan import Plan, engines_of

    scene = read_scene(scene)
    fixed = fixed_values(scene, fix)
    scene = with_values(scene, fixed) if fixed else scene
    axes, engines = parse_axes(scene, over), engines_of(scene, engine)
    check_axes(axes, fixed)
    hybrid = engine == "hybrid"
    return Plan(scene, axes, engines, keep_waveforms=keep_waveforms, hybrid=hybrid)


def montecarlo(
    scene: str | Path | Scene,
    *,
    engine: str | None = "statespace",
    samples: int = 1000,
    seed: int = 1,
    until: str | float | None = None,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    remedy: bool = True,
    progress: Progress = lambda stage: None,
) -> YieldReport:
    """Verify a scene with random components within its tolerances and estimate the yield.

    In a script, call it below ``if __name__ == "__main__":``, since its processes import the
    script.

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"``; None for the scene's own engine.
    samples : int
        Largest number of boards to draw.
    seed : int
        Seed of the samples: sample 17 of a seed is the same board on every machine.
    until : str or float, optional
        Stop when the half width of the 95 % interval is below this: ``"1%"`` or 0.01.
    output : path, optional
        A database (``.sqlite``); samples that it holds are not computed again.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler, ``"tcp://host:port"``, that runs the samples.
    remedy : bool
        Whether to find, below a yield of 99 %, what to buy better, and to draw up to 300 samples
        again with it.
    progress : callable, optional
        Receives the number of finished samples.

    Returns
    -------
    YieldReport
        The yield (a sample without a verdict counts as not passed), its 95 % interval, the failed
        checks, the parts with the largest influence, and `remedy`; `plot` draws histograms.

    Raises
    ------
    InputError
        The scene, the tolerances or the database cannot be used.
    NoVerdictError
        The problem has no solution, or a sample needs ngspice and ngspice is missing.

    Examples
    --------
    >>> import taction
    >>> taction.montecarlo("scenes/tuned-breadboard.toml", samples=4, jobs=1).samples
    4
    """
    from taction.results import YieldReport
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.tolerance.drawing import (
        SampleCollection,
        draw_samples,
        half_width,
    )
    from taction.verification.studies.tolerance.remedy_search import verified_remedy
    from taction.verification.studies.tolerance.varied_board import prepare
    from taction.verification.studies.tolerance.yield_report import summarise_samples

    tally = SampleCollection(samples, half_width(until))
    study = prepare(read_scene(scene, engine))
    workers = partial(workers_at, cluster, jobs, progress)
    draw_samples(study, seed, tally, workers(), output, progress)
    summary = summarise_samples(study, tally.samples, seed)
    report = YieldReport.of(summary, study.scene.name, tally.samples)
    if not remedy:
        return report
    ask = partial(verified_remedy, output=output, progress=progress)
    return replace(report, remedy=ask(study, tally.samples, seed, workers))
