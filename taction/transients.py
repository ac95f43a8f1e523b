"""Jobs with one transient of a scene, or of each scene: simulate, verify, compare, explore."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, overload

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.netlist_gen.scene.scene import Scene
    from taction.system.progress import Progress
    from taction.verification.design.remedies import Remedies
    from taction.verification.studies.regression.difference import VerdictDifference
    from taction.verification.studies.scene_files import VerifiedFiles
    from taction.verification.verdict.verify import Verdict

AnyScene: TypeAlias = "str | Path | Scene"
Settings: TypeAlias = "Sequence[str] | Mapping[str, Any]"


def simulate(
    scene: AnyScene,
    *,
    engine: str | None = None,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Verdict:
    """Verify SCENE, and write the waveforms of its record.

    Parameters
    ----------
    scene : path or Scene
        The board.
    engine : {"auto", "ngspice", "statespace"}, optional
        Engine in the place of the scene's own.
    output : path, optional
        File for the waveforms: .csv, .parquet or .raw.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Verdict
        With its `waveforms` and `measurements`.

    Raises
    ------
    InputError
        The scene or the file cannot be used.
    NoVerdictError
        The engine gave no result.

    Examples
    --------
    >>> import taction
    >>> record = taction.simulate("scenes/tuned-breadboard.toml", engine="statespace")
    >>> record.measurements.channels[3].state.value
    'settled'
    """
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.report.output_checks import check_export, export
    from taction.verification.verdict.verify import verify as verify_one

    scene = read_scene(scene, engine)
    if output is not None:
        check_export(str(output))
    verdict = verify_one(scene, progress)
    if output is not None:
        export(verdict.circuit, verdict.waveforms, str(output))
    return verdict


@overload
def verify(
    scene: AnyScene,
    *,
    engine: str | None = ...,
    settings: Settings = ...,
    strains: None = ...,
    progress: Progress = ...,
) -> Verdict: ...
@overload
def verify(
    scene: AnyScene,
    *,
    engine: str | None = ...,
    settings: Settings = ...,
    strains: ArrayLike,
    progress: Progress = ...,
) -> list[Verdict]: ...
def verify(
    scene: AnyScene,
    *,
    engine: str | None = None,
    settings: Settings = (),
    strains: ArrayLike | None = None,
    progress: Progress = lambda stage: None,
) -> Verdict | list[Verdict]:
    """Simulate the board of each SCENE, solve its problem, and check the board.

    Parameters
    ----------
    scene : path or Scene
        The board, its problem and the checks.
    engine : {"auto", "ngspice", "statespace"}, optional
        Engine in the place of the scene's own.
    settings : sequence of str, or mapping
        Another value for a key of one scene: C=12pF, lambda=0.5, design.opamp=tl084. Repeat it for
        several keys.

        In Python: ``["C=12pF", "lambda=0.5"]`` or ``{"C": "12pF", "lambda": 0.5}``.
    strains : array_like (K, M), optional
        Verify for each row instead of the scene's strain, which still decides a lambda by a rule.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Verdict or list of Verdict
        ``print(verdict)`` shows the screen of the command; `outcome` is pass, fail or inconclusive.
        With `strains`: one verdict per row.

    Raises
    ------
    InputError
        The scene or the strains cannot be used.
    NoVerdictError
        No engine gave a result, or the numerical solution has no certificate.

    Examples
    --------
    >>> import taction
    >>> scene, strains = "scenes/custom-matrix.toml", [[0.2] * 6, [0.1] * 6]
    >>> taction.verify(scene, engine="statespace").outcome.value
    'pass'
    >>> [each.outcome.value for each in taction.verify(scene, engine="statespace", strains=strains)]
    ['pass', 'fail']
    """
    from taction.netlist_gen.scene.scene import load_scene

    if isinstance(scene, str | Path):
        scene = load_scene(scene)  # first: to refuse a scene takes neither numpy nor the engines
    if settings:
        from taction.netlist_gen.scene.axes import with_settings

        pairs = settings.items() if isinstance(settings, Mapping) else ()
        texts = [f"{key}={value}" for key, value in pairs] or list(settings)
        scene = with_settings(scene, texts)
    from taction.netlist_gen.scene.inverse_problem import with_strains
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.verdict.verify import verify as verify_one

    scene = read_scene(scene, engine)
    if strains is None:
        return verify_one(scene, progress)
    problems = with_strains(scene, strains)
    return [verify_one(scene, progress, problem=problem) for problem in problems]


def verify_files(
    scenes: Sequence[str | Path],
    *,
    engine: str | None = None,
    margins: bool = False,
    jobs: int | None = None,
    progress: Progress = lambda stage: None,
) -> VerifiedFiles:
    """Verify several scene files; a file without a verdict is a result, too.

    Parameters
    ----------
    scenes : sequence of path
        Scene files, and folders: all their files ``*.toml``.
    engine : {"auto", "ngspice", "statespace"}, optional
        Engine in the place of the scene's own.
    margins : bool
        Show by what factor C may shrink and the gain may grow until the board oscillates.
    jobs : int, optional
        Number of processes; by default one per core.
    progress : callable, optional
        Receives the number of finished scenes.

    Returns
    -------
    VerifiedFiles
        `documents` holds the verdict of each scene as plain data, in the order of the files.

    Raises
    ------
    InputError
        A folder without scenes.
    Interrupted
        Ctrl-C; its `result` has the finished scenes.

    Examples
    --------
    >>> import taction
    >>> files = ["scenes/custom-matrix.toml", "scenes/paper-breadboard.toml"]
    >>> found = taction.verify_files(files, jobs=1)
    >>> found.outcome, found.count()
    ('pass', {'pass': 2})
    """
    from taction.system.documents import plain
    from taction.system.errors import Interrupted
    from taction.system.results import load
    from taction.verification.studies import scene_files
    from taction.verification.studies.running.study import for_each

    files = scene_files.scene_files([str(name) for name in scenes])
    place = "taction.verification.report.documents.verdict:verdict_document_with_margins"
    describe, names = load(place) if margins else plain, [path.stem for path in files]
    calls = [(path, describe, engine) for path in files]
    run, without = scene_files.verify_file, scene_files.without_verdict
    results = for_each(run, calls, names, without, jobs=jobs, progress=progress)
    found = scene_files.VerifiedFiles(tuple(results))
    if found.interrupted:
        raise Interrupted("the finished scenes are in the report", found)
    return found


def what_to_change(
    verdict: Verdict,
    *,
    changes: float = 2000.0,
    progress: Progress = lambda stage: None,
) -> Remedies | None:
    """Return the nearest changes of the design that mend a failed verdict; None for any other.

    Parameters
    ----------
    verdict : Verdict
        Of the board that its scene describes.
    changes : float
        Most work of the search for changes that mend a failed verdict, in designs; 0: no search.

        A verdict is 10 designs; a board of n states counts ``1 + (n / 70)^3`` times.
    progress : callable, optional
        Receives the name of the stage.

    Returns
    -------
    Remedies or None
        Changes that were verified.

    Raises
    ------
    InputError
        The files of the scene cannot be read any more.

    Examples
    --------
    >>> import taction
    >>> verdict = taction.verify("scenes/paper-breadboard.toml", engine="statespace")
    >>> print(taction.what_to_change(verdict))
    None
    """
    if not changes or verdict.outcome.value != "fail":
        return None
    from taction.verification.design.remedies import find_remedies

    progress(f"what to change, at most the work of {changes:g} designs")
    return find_remedies(verdict, changes)


def diff(
    first: str | Path | Scene | Verdict,
    second: str | Path | Scene | Verdict,
    *,
    engine: str | None = None,
    agree: float = 1e-3,
    progress: Progress = lambda stage: None,
) -> VerdictDifference:
    """Compare two boards: the keys or parts that differ, then the readings.

    A and B are scenes, decks (.cir, .sp, .net, .spice, .ckt), or raw files of a transient (.raw),
    of which one is compared with a scene or a deck.

    Parameters
    ----------
    first, second : path, Scene or Verdict
        A scene, a deck, a raw file, or a verdict. A scene beside a deck stands for the deck that it
        writes.
    engine : {"auto", "ngspice", "statespace"}, optional
        Engine in the place of the scene's own.

        A deck or a raw file is compared by the state-space engine.
    agree : float
        Accepted error of a raw file's waveforms, as a share of the largest step.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    VerdictDifference
        `keys` and `readings` with their differences and the uncertainties of these; `plot` draws
        both waveforms over each other.

    Raises
    ------
    InputError
        A scene or a file cannot be used.
    NoVerdictError
        A scene has no verdict, or a deck or a record no exact solution.

    Examples
    --------
    >>> import taction
    >>> scene = "scenes/paper-breadboard.toml"
    >>> taction.diff(scene, scene, engine="statespace").exit_status
    0
    """
    from taction.verification.studies.regression.difference import (
        compare_circuits,
        compare_verdicts,
        is_circuit,
        refuse_pair,
    )

    refuse_pair(first, second)
    if is_circuit(first) or is_circuit(second):
        progress("decks")
        return compare_circuits(first, second, agree)
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.report.documents.verdict import scene_keys
    from taction.verification.verdict.verify import Verdict

    given = first, second
    read = [one if isinstance(one, Verdict) else read_scene(one, engine) for one in given]
    one, two = (
        each if isinstance(each, Verdict) else verify(each, progress=progress) for each in read
    )
    name, named = (
        str(place) if isinstance(place, str | Path) else found.scene.name
        for place, found in zip(given, (one, two), strict=True)
    )
    return compare_verdicts(one, two, (scene_keys(one.scene), scene_keys(two.scene)), (name, named))


def explore(
    scene: str | Path | Scene,
    *,
    port: int = 0,
    browser: bool = True,
    announce: Callable[[str], None] = print,
) -> None:
    """Serve a page with sliders for C, gain, lambda, stray capacitance and noise, until Ctrl-C.

    Waveforms, poles, stable values of C and the recovered stress follow at once, by the state-space
    engine; the verdict follows when it is ready. The page is for this machine alone, and its
    address has a secret.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    port : int
        Port of the page on 127.0.0.1; 0 is any free port.
    browser : bool
        Open the page in a browser, where there is a display.
    announce : callable
        Receives the address once the page can be opened.

    Raises
    ------
    InputError
        The scene cannot be used, a package is missing (``taction[explore]``), or the port is taken.

    Examples
    --------
    The call ends with Ctrl-C.

    >>> import taction
    >>> taction.explore("scenes/tuned-breadboard.toml", port=8000)  # doctest: +SKIP
    """
    from contextlib import suppress

    from taction.netlist_gen.scene.scene import load_scene
    from taction.verification.report.explorer.server import explore as serve

    scene = load_scene(scene) if isinstance(scene, str | Path) else scene
    with suppress(KeyboardInterrupt):
        serve(scene, port=port, show=browser, announce=announce)
