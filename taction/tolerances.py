"""Jobs that verify boards of parts with tolerances: at random, one sample, at the corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taction.netlist_gen.scene.scene import Scene
    from taction.system.progress import Progress
    from taction.verification.studies.tolerance.corners import CornerStudy
    from taction.verification.studies.tolerance.varied_board import VerifiedSample
    from taction.verification.studies.tolerance.yield_report import YieldReport


def montecarlo(
    scene: str | Path | Scene,
    *,
    engine: str | None = "statespace",
    samples: int = 1000,
    seed: int = 1,
    until: str | float | None = None,
    min_yield: float | None = None,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> YieldReport:
    """Verify SCENE with random components within its [tolerances] and estimate the yield.

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    engine : str, optional
        Engine of all samples.

        ``"auto"``, ``"ngspice"`` or ``"statespace"``; None for the scene's own engine.
    samples : int
        Most samples to draw.
    seed : int
        Seed of the samples.

        Sample 17 of a seed is the same board on every machine.
    until : str or float, optional
        Stop when the half width of the 95 % interval is below this: 1% or 0.01.
    min_yield : float, optional
        Smallest yield that passes.
    output : path, optional
        Database that stores every sample; a later run computes only the missing ones.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the number of finished samples.

    Returns
    -------
    YieldReport
        The yield (a sample without a verdict counts as not passed), its 95 % interval, the failed
        checks, the parts with the largest influence; `plot` draws histograms.

    Raises
    ------
    InputError
        The scene, the tolerances or the database cannot be used.
    NoVerdictError
        The problem has no solution, or a sample needs ngspice and ngspice is missing.
    Interrupted
        Ctrl-C; its `result` has the finished samples.

    Examples
    --------
    >>> import taction
    >>> taction.montecarlo("scenes/tuned-breadboard.toml", samples=4, jobs=1).samples
    4
    """
    from taction.system.errors import Interrupted
    from taction.system.progress import Notice
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.tolerance.drawing import SampleCollection, draw_samples
    from taction.verification.studies.tolerance.samples import half_width
    from taction.verification.studies.tolerance.varied_board import prepare
    from taction.verification.studies.tolerance.yield_report import summarise_samples

    tally = SampleCollection(samples, half_width(until))
    study = prepare(read_scene(scene, engine))
    workers = partial(workers_at, cluster, jobs, lambda text: progress(Notice(text)))
    complete = False
    try:
        draw_samples(study, seed, tally, workers(), output, progress)
        complete = True
    except KeyboardInterrupt:
        pass
    report = replace(
        summarise_samples(study, tally.samples, seed),
        min_yield=min_yield,
        complete=complete,
        scene=study.scene,
    )
    if not complete:
        raise Interrupted("the report holds the finished samples", report)
    return report


def verify_sample(
    scene: str | Path | Scene,
    *,
    sample: int,
    engine: str | None = "statespace",
    seed: int = 1,
) -> VerifiedSample:
    """Verify one sample of a Monte Carlo study in full.

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    sample : int
        Verify only the sample with this number.
    engine : str, optional
        Engine of all samples.

        ``"auto"``, ``"ngspice"`` or ``"statespace"``; None for the scene's own engine.
    seed : int
        Seed of the samples.

    Returns
    -------
    VerifiedSample
        The verdict, the sample as the study has it, and the deviation of each part.

    Raises
    ------
    InputError
        The scene or the tolerances cannot be used.
    NoVerdictError
        The sample has no verdict.

    Examples
    --------
    >>> import taction
    >>> found = taction.verify_sample("scenes/tuned-breadboard.toml", sample=2)
    >>> found.outcome == found.sample.outcome
    True
    """
    from taction.netlist_gen.board.variation import draw
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.studies.tolerance.samples import evaluate
    from taction.verification.studies.tolerance.varied_board import VerifiedSample, prepare
    from taction.verification.verdict.verify import verify

    study = prepare(read_scene(scene, engine))
    z = draw(study.tolerances, study.varied, seed, sample)
    board = study.at(z)
    verdict = verify(study.scene, problem=study.problem, circuit=board, ideal=study.ideal)
    deviations = {p.name: float(v) for p, v in zip(study.varied, z, strict=True)}
    return VerifiedSample(verdict, evaluate(study, sample, z), seed, deviations)


def corners(
    scene: str | Path | Scene,
    *,
    corner: Sequence[str | Mapping[str, float]] = (),
    engine: str | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> CornerStudy:
    """Verify SCENE with the components at the ends of their [tolerances].

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    corner : sequence of str or mapping
        Verify this corner only, in units of the tolerances: capacitor=-1,opamp_gbw=-1,Rf_3_5=1.
        Repeat the option for several corners.

        In Python a list of such texts, or of ``{"capacitor": -1.0}``.
    engine : str, optional
        Engine in the place of the scene's own.

        ``"auto"``, ``"ngspice"`` or ``"statespace"``.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    CornerStudy
        The nominal board and the worst corner of every quantity, or the corners that were named.

    Raises
    ------
    InputError
        The scene or the tolerances cannot be used, nothing varies, or a corner is none.
    NoVerdictError
        The problem has no solution, or the cluster is gone.

    Examples
    --------
    >>> import taction
    >>> study = taction.corners("scenes/tuned-breadboard.toml", corner=["capacitor=-1"])
    >>> study.corners[0].name, study.outcome
    ('capacitor=-1', 'pass')
    """
    from taction.system.progress import Notice
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.tolerance.corners import (
        CornerStudy,
        deviations_of,
        named_corner,
        worst_corners,
    )
    from taction.verification.studies.tolerance.varied_board import prepare

    scene = read_scene(scene, engine)
    named = [deviations_of(each) for each in corner]
    if named:
        study = prepare(scene, full_margin=True)
        found = tuple(named_corner(study, *each) for each in named)
        return CornerStudy(study.name, study.quantities, found, scene=scene)
    with workers_at(cluster, jobs, lambda text: progress(Notice(text))) as workers:
        return worst_corners(scene, workers, progress)
