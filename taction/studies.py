"""Jobs that verify or analyse a scene many times: onset, sweep, Monte Carlo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from netlist_gen.overrides.axes import Over
    from netlist_gen.scene.scene import Scene
    from verification.pipeline.clock import Progress
    from verification.report.sweep.result import SweepResult
    from verification.studies.onset.onset import Onset
    from verification.studies.sweep.run import Count
    from verification.studies.tolerance.yield_report import YieldReport


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
        The axis: ``{"C": ("2pF", "20pF", 13)}`` (lowest, highest, number of points), the same as
        on the command line (``"C=2pF:20pF:13"``), or a bare key, which stands for a thirtieth to
        thirty times the scene's own value.
    transients : bool
        Confirm each crossing by transients of ngspice on both sides.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Onset
        `findings` holds the crossings, each with its frequency and its confirmation.

    Raises
    ------
    InputError
        The scene or the axis cannot be used.
    NoVerdictError
        No value on the axis gives a board whose poles can be computed.

    Notes
    -----
    Crossings are solved on the poles; a transient never moves one, but may contradict it.

    Examples
    --------
    >>> import taction
    >>> found = taction.onset(
    ...     "scenes/paper-breadboard.toml", over={"C": ("5pF", "20pF", 13)}, transients=False
    ... )
    >>> print(f"stable from {found.findings[-1].crossing.value:.3g} F")
    stable from 9.02e-12 F
    """
    from verification.ideal.lambda_rule import read_scene
    from verification.studies.onset.onset import onset as run
    from verification.studies.onset.onset import parse_onset_axis

    asked = read_scene(scene)
    axis = parse_onset_axis(asked, over)
    return run(asked, axis, transients=transients, progress=progress)


def sweep(
    scene: str | Path | Scene,
    *,
    over: Over,
    engine: str | None = None,
    once: bool = False,
    keep_waveforms: bool = False,
    retry_failed: bool = False,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> SweepResult:
    """Verify a scene at every point of a grid.

    Parameters
    ----------
    scene : path or Scene
        The scene whose values change.
    over : mapping, str or iterable of str
        The axes, by key: a tuple ``("1pF", "1nF", 31)`` is a range of 31 points with logarithmic
        spacing (``"lin"`` behind it: linear), a list holds the values themselves. Strings are
        read as on the command line (``"C=1pF:1nF:31"``).
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"`` in the place of the scene's own engine, or
        ``"both"``.
    once : bool
        Run ngspice once a point; its error is measured against the state-space engine.
    keep_waveforms : bool
        Store the outputs over time.
    retry_failed : bool
        Compute points again that reached no verdict.
    output : path, optional
        A database (``.sqlite``): points that it holds are not computed again. Without it the
        points are kept in memory.
    jobs : int, optional
        Processes; one a core by default.
    cluster : str, optional
        Address of a Dask scheduler, ``"tcp://host:port"``, in the place of processes here.
    progress : callable, optional
        Receives the number of points that are done.

    Returns
    -------
    SweepResult
        `to_pandas`, `to_xarray`, `plot` and `records` give the points.

    Raises
    ------
    InputError
        The scene, an axis or the database cannot be used.
    NoVerdictError
        There is no ngspice where one is asked for, or the cluster is gone.

    Notes
    -----
    A point that reaches no verdict is a row of the result with its reason, not an exception. In a
    script, call `sweep` below ``if __name__ == "__main__":``, since its processes import the
    script.

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
    from netlist_gen.overrides.axes import parse_axes
    from verification.ideal.lambda_rule import read_scene
    from verification.report.sweep.result import SweepResult
    from verification.studies.running.executors import workers_at
    from verification.studies.sweep.plan import Plan, engines_of
    from verification.studies.sweep.run import sweep as run
    from verification.studies.sweep.store import Store

    asked = read_scene(scene)
    plan = Plan(
        asked,
        parse_axes(asked, over),
        engines_of(asked, engine),
        second_look=not once,
        keep_waveforms=keep_waveforms,
    )
    store = Store(":memory:" if output is None else str(output))

    def show(count: Count) -> None:
        progress(f"{count.done} of {count.total} points")

    with workers_at(cluster, jobs) as workers:
        count = run(plan, store, workers, retry_failed=retry_failed, progress=show)
    return SweepResult(plan, store, count)


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
    progress: Progress = lambda stage: None,
) -> YieldReport:
    """Verify a scene with components drawn from its tolerances, and return the yield.

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"``; None for the scene's own engine.
    samples : int
        Boards to draw, at the most.
    seed : int
        Sample 17 of one seed is the same board on every machine.
    until : str or float, optional
        Stop when the 95 % interval is this narrow on either side: ``"1%"`` or 0.01.
    output : path, optional
        Keep the samples in this file as JSON lines; samples that it holds are not drawn again.
    jobs : int, optional
        Processes; one a core by default.
    cluster : str, optional
        Address of a Dask scheduler, ``"tcp://host:port"``, in the place of processes here.
    progress : callable, optional
        Receives the number of samples that are done.

    Returns
    -------
    YieldReport
        The fraction that passes, its 95 % interval, what failed, and which parts matter.

    Raises
    ------
    InputError
        The scene, the tolerances or the file cannot be used.
    NoVerdictError
        The problem has no solution, or there is no ngspice where one is asked for.

    Notes
    -----
    A sample without a verdict is no pass and counts among the samples. In a script, call
    `montecarlo` below ``if __name__ == "__main__":``, since its processes import the script.

    Examples
    --------
    >>> import taction
    >>> taction.montecarlo("scenes/tuned-breadboard.toml", samples=4, jobs=1).samples
    4
    """
    from verification.ideal.lambda_rule import read_scene
    from verification.studies.running.executors import workers_at
    from verification.studies.tolerance.drawing import draw_samples, half_width
    from verification.studies.tolerance.varied_board import prepare
    from verification.studies.tolerance.yield_report import Tally, report

    tally = Tally(samples, half_width(until))
    study = prepare(read_scene(scene, engine))
    draw_samples(study, seed, tally, workers_at(cluster, jobs), output, progress)
    return report(study, tally.samples, seed)
