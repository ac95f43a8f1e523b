"""Jobs that verify or analyse many boards: onset, sweep, regression, evidence."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taction.netlist_gen.scene.axes import Fixed, Over
    from taction.netlist_gen.scene.scene import Scene
    from taction.system.progress import Progress
    from taction.verification.evidence.paper.reproduce import Reproduction
    from taction.verification.evidence.stress.run import StressReport
    from taction.verification.studies.onset.onset import Onset
    from taction.verification.studies.regression.run import RegressionReport
    from taction.verification.studies.sweep.result import SweepResult
    from taction.verification.studies.work_precision.study import WorkPrecisionStudy


def onset(
    scene: str | Path | Scene,
    *,
    over: Over,
    transients: bool = True,
    progress: Progress = lambda stage: None,
) -> Onset:
    """Find every value of a key at which the board of SCENE begins or ceases to oscillate.

    Parameters
    ----------
    scene : path or Scene
        The board.
    over : mapping, str or iterable of str
        Key to change: C, gain, stray_capacitance or any other number of the scene. Without a range:
        from 1/30 to 30 times the scene's own value.

        ``{"C": ("2pF", "20pF", 13)}`` (lowest, highest, number of points), as on the command line
        (``"C=2pF:20pF:13"``), or a key alone.
    transients : bool
        Run ngspice on both sides of each crossing.
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
    from taction.verification.studies.onset.onset import onset as find_crossings
    from taction.verification.studies.onset.onset import planned

    return find_crossings(*planned(scene, over), transients=transients, progress=progress)


def sweep(
    scene: str | Path | Scene,
    *,
    over: Over,
    engine: str | None = None,
    fix: Fixed = (),
    strict: bool = False,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> SweepResult:
    """Verify SCENE at every point of a grid and store the results.

    A point without a verdict has its reason. The same command continues an interrupted sweep, and
    computes points without a verdict again.

    Parameters
    ----------
    scene : path or Scene
        The scene whose values change.
    over : mapping, str or iterable of str
        Axis of the grid: C=1pF:1nF:31 (31 points, logarithmic), C=1pF:1nF:31:lin (linear) or
        C=1p,2p (values). Two axes in one option, with a blank between them, change together. Repeat
        the option for a grid.

        In Python the axes by key: a tuple ``("1pF", "1nF", 31)`` is a range of 31 points with
        logarithmic spacing (``("1pF", "1nF", 31, "lin")``: linear), a list holds the values.
        Strings are read as on the command line (``"C=1pF:1nF:31"``).
    engine : str, optional
        Engine in the place of the scene's own.
    fix : mapping, str or iterable of str
        Hold a key at every point, by default at the scene's own value: --fix lambda holds lambda
        where the scene gives a resistance. Repeat the option for several keys.

        In Python ``"lambda"``, or ``{"lambda": 0.5}`` or ``"lambda=0.5"`` for another value.
    strict : bool
        A point that fails makes the outcome of the sweep fail.
    output : path, optional
        Database of the results; by default the name of the scene's file with the ending .sqlite.

        Points that it holds are not computed again. In Python the points stay in memory by
        default.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the number of finished points with the remaining time.

    Returns
    -------
    SweepResult
        `to_pandas`, `to_xarray`, `plot` and `records` give the points.

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
    SweepResult('paper-breadboard', C x opamp.base: 4 points, 4 fail)
    >>> result.to_pandas()["stable"].tolist()
    [False, True, True, True]
    """
    from taction.verification.studies.store import Store
    from taction.verification.studies.sweep.plan import plan_sweep
    from taction.verification.studies.sweep.result import SweepResult
    from taction.verification.studies.sweep.run import computed

    plan = plan_sweep(scene, over, engine, fix=fix)
    store, start = Store(":memory:" if output is None else str(output)), time.perf_counter()
    count = computed(plan, store, jobs=jobs, cluster=cluster, progress=progress)
    return SweepResult(plan, store, count, time.perf_counter() - start, strict)


def regress(
    folder: str | Path,
    *,
    baseline: str | Path,
    update: bool = False,
    jobs: int | None = None,
    progress: Progress = lambda stage: None,
) -> RegressionReport:
    """Verify every scene (``*.toml``) in DIR and compare the results with the baseline.

    Parameters
    ----------
    folder : path
        Folder of the scenes.
    baseline : path
        Stored results (JSON).
    update : bool
        Write changed results into the baseline; scenes that fail stay as they were.
    jobs : int, optional
        Number of processes; by default one per core.
    progress : callable, optional
        Receives the number of finished scenes.

    Returns
    -------
    RegressionReport
        The status of every scene, and what differs.

    Raises
    ------
    InputError
        The folder holds no scene, or the baseline cannot be used.
    Interrupted
        Ctrl-C; its `result` has the finished scenes.

    Examples
    --------
    >>> import taction, tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     text = Path("scenes/tuned-breadboard.toml").read_text()
    ...     made = Path(folder, "a.toml").write_text(text)
    ...     file = Path(folder, "baseline.json")
    ...     first = taction.regress(folder, baseline=file, update=True, jobs=1)
    ...     taction.regress(folder, baseline=file, jobs=1).count()
    {'same': 1}
    """
    from taction.system.atomic_files import write_atomically
    from taction.system.errors import Interrupted
    from taction.verification.report.output_checks import check_folder
    from taction.verification.studies.regression.baseline import (
        NO_COMMIT,
        baseline_text,
        commit_of,
        load_baseline,
    )
    from taction.verification.studies.regression.run import regress as run
    from taction.verification.studies.regression.run import updated_baseline

    check_folder(str(baseline), "--baseline")
    fresh = update and not Path(baseline).exists()
    entries = {} if fresh else load_baseline(baseline)
    written = NO_COMMIT if fresh else commit_of(baseline)
    report = run(
        folder, baseline, entries, written=written, updated=update, jobs=jobs, progress=progress
    )
    if update:
        kept = updated_baseline(report, entries)
        same = written.text and kept == entries
        write_atomically(baseline, baseline_text(kept, written if same else report.commit))
    if report.interrupted:
        raise Interrupted("the finished scenes are in the report", report)
    return report


def accuracy(
    scene: str | Path | Scene, *, budget: float = 30.0, progress: Progress = lambda stage: None
) -> WorkPrecisionStudy:
    """Compare the error and the run time of every engine, method and setting on SCENE.

    Parameters
    ----------
    scene : path or Scene
        The board.
    budget : float
        Wall time for the runs, s; the finest settings are left out when it is used up.
    progress : callable, optional
        Receives the name of each stage, with what is left of the budget.

    Returns
    -------
    WorkPrecisionStudy
        Every run with its error and its time; `conclusive` if a run has a known error.

    Raises
    ------
    InputError
        The scene cannot be used.

    Examples
    --------
    >>> import taction
    >>> study = taction.accuracy("scenes/tuned-breadboard.toml", budget=0.5)
    >>> study.scene.name, len(study.points) > 0
    ('tuned-breadboard', True)
    """
    from taction.system.progress import duration
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.studies.work_precision.study import run_study

    end = time.monotonic() + budget

    def of_budget(stage: str) -> None:
        progress(f"{stage}, about {duration(max(end - time.monotonic(), 0.0))} left")

    return run_study(read_scene(scene), budget=budget, progress=of_budget)


def stress(
    *,
    only: Sequence[str] = (),
    jobs: int | None = None,
    progress: Progress = lambda stage: None,
) -> StressReport:
    """Verify the catalogue of stiff and extreme scenes, whose right results are known.

    Every outcome is compared with the right outcome, and every number with its true value, if it is
    at hand: a checkout has the true values, an installed taction only the outcomes. So a run
    shows whether ngspice and the numerical libraries of this machine give right answers. Numbers
    outside their stated uncertainty are counted; a number is wrong that misses its true value by
    more than the uncertainty and the accuracy that the scene asks for.

    Parameters
    ----------
    only : sequence of str
        Run one case, or one family; repeatable.
    jobs : int, optional
        Number of processes; by default one per core.
    progress : callable, optional
        Receives the number of cases, then each run.

    Returns
    -------
    StressReport
        Every run with its judgement; `wrong` are those with a wrong outcome or number.

    Raises
    ------
    InputError
        There is no such case or family.
    Interrupted
        Ctrl-C; its `result` has the finished cases.

    Examples
    --------
    >>> import taction
    >>> len(taction.stress(only=["nothing-moves"], jobs=1).wrong)
    0
    """
    from taction.system.errors import Interrupted
    from taction.system.progress import Notice
    from taction.verification.evidence.stress.catalogue import load_catalogue, select
    from taction.verification.evidence.stress.run import run_catalogue

    cases = select(load_catalogue(), tuple(only))
    progress(Notice(f"cases: {len(cases)}"))
    report = run_catalogue(cases, progress, jobs)
    if report.interrupted:
        raise Interrupted("the finished cases are in the report", report)
    return report


def reproduce(*, quick: bool = False, progress: Progress = lambda stage: None) -> Reproduction:
    """Test every claim of the paper, and four about boards of one loop.

    Parameters
    ----------
    quick : bool
        Run fewer seeds and sizes, for CI.
    progress : callable, optional
        Receives how long the run takes, then each chapter.

    Returns
    -------
    Reproduction
        The verdict on every claim, with what was found.

    Examples
    --------
    The quick run takes some minutes.

    >>> import taction
    >>> taction.reproduce(quick=True).outcome  # doctest: +SKIP
    'pass'
    """
    from taction.system.progress import Notice
    from taction.verification.evidence.paper.reproduce import reproduce as run

    return run(quick=quick, progress=lambda stage: progress(Notice(stage)))
