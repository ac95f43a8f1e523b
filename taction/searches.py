"""Jobs that find a design: tune, choose, scale, and a new scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taction.netlist_gen.scene.scene import Scene
    from taction.system.progress import Progress
    from taction.verification.design.choose import Choice
    from taction.verification.design.fresh_scene import NewScene
    from taction.verification.design.scaling import Scaled
    from taction.verification.design.tune import Tuned


def tune(
    scene: str | Path | Scene,
    *,
    over: str | Sequence[str] = "gain",
    reach: float = 20.0,
    overshoot: float | None = None,
    margin: float | None = None,
    any_part: bool = False,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Tuned:
    """Find the values with the least settling time, at the scene's lambda, and verify the design.

    The search uses the state-space engine, all checks of the scene, and values that can be bought:
    in the scene's series, else of three digits. The verification decides the exit status; its
    checks include the limits of the search.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    over : str or sequence of str
        Keys to change, each with an optional range: gain,capacitance or gain=1M:10M.
    reach : float
        A key without a range goes from its value divided by this factor to its value times it.
    overshoot : float, optional
        Largest overshoot, fraction of the step; by default the scene's limit, or 0.05.
    margin : float, optional
        Factor by which C must be able to shrink; by default the scene's margin.
    any_part : bool
        Accept parts beyond the limits of real ones.
    output : path, optional
        Write the scene with the best design.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Tuned
        `tuning` with the design before and after, and the `verdict` of the best design.

    Raises
    ------
    InputError
        The scene, a key or a range cannot be used.
    NoVerdictError
        No design passes the checks; the message has the one that came closest.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/tuned-breadboard.toml").with_engine("statespace")
    >>> tuned = taction.tune(scene, over="gain", reach=4.0)
    >>> tuned.tuning.after.settling_time <= tuned.tuning.before.settling_time
    True
    """
    from taction.verification.design.tune import Tuned
    from taction.verification.design.tune import tune as run
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.verdict.verify import verify

    named = over.split(",") if isinstance(over, str) else over
    keys = [key.strip() for key in named if key.strip()]
    limits = {"overshoot": overshoot, "margin": margin, "reach": reach}
    tuning = run(read_scene(scene), keys, **limits, any_part=any_part, progress=progress)
    tuned = Tuned(tuning, verify(tuning.scene, progress), reach)
    if output is not None:
        _write_scene(tuning.scene, output)
    return tuned


def choose(
    scene: str | Path | Scene,
    *,
    settling: str | float | None = None,
    rise: str | float | None = None,
    overshoot: str | float | None = None,
    noise: str | float | None = None,
    margin: str | float | None = None,
    supply: str | float | None = None,
    opamps: str | Sequence[str] = (),
    c_range: str = "",
    gain_range: str = "",
    points: int = 9,
    any_part: bool = False,
    output: str | Path | None = None,
    store: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> Choice:
    """Choose op-amp, C and gain of SCENE: all designs of a grid, ranked by checks and headroom.

    Lambda, and with it the solution, stays; C and gain take values that can be bought. The
    state-space engine verifies every design, and ngspice the best three. The same command continues
    an interrupted one.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    settling : str or float, optional
        Largest settling time: 10us.
    rise : str or float, optional
        Largest rise time of any channel.
    overshoot : str or float, optional
        Largest overshoot: 5% or 0.05.
    noise : str or float, optional
        Largest output noise of a channel: 1mV.
    margin : str or float, optional
        Factor by which C must be able to shrink.
    supply : str or float, optional
        Supply of the op-amps: 15V.
    opamps : str or sequence of str
        Presets; by default all of them.
    c_range : str
        By default the scene's C from a tenth to ten times its value.
    gain_range : str
        By default the scene's gain from a tenth to ten times its value.
    points : int
        Values of C and of gain.
    any_part : bool
        Accept parts beyond the limits of real ones.
    output : path, optional
        Write the best three designs as scene files into FOLDER.
    store : path, optional
        Database of the results; by default the scene's name with -choose.sqlite.

        In Python the results stay in memory by default.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the number of finished designs.

    Returns
    -------
    Choice
        All designs, the best of them, and what ngspice says about these.

    Raises
    ------
    InputError
        The scene, a limit, an op-amp or a range cannot be used, or the folder is not empty.
    NoVerdictError
        The cluster is gone.
    Interrupted
        Ctrl-C; the text says what is stored.

    Examples
    --------
    >>> import taction
    >>> found = taction.choose(
    ...     "scenes/tuned-breadboard.toml", settling="1ms", opamps=["tl084"], points=2, jobs=1
    ... )
    >>> len(found.designs)
    4
    """
    from taction.netlist_gen.board.part_warnings import ANY_PART
    from taction.system.output_files import check_empty_folder, make_folder
    from taction.verification.design.choice_plan import choice_plan, request_of
    from taction.verification.design.choose import (
        Choice,
        best_designs,
        confirmed,
        design_scene,
        designs,
    )
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.studies.store import Store
    from taction.verification.studies.sweep.run import computed

    if output is not None:
        check_empty_folder(output)
    original = read_scene(scene)
    request = request_of(
        opamps, c_range, gain_range, points,
        settling=settling, rise=rise, overshoot=overshoot, noise=noise, margin=margin,
        supply=supply,
    )  # fmt: skip
    plan = choice_plan(original, request)
    with Store(":memory:" if store is None else str(store)) as results:
        computed(plan, results, jobs=jobs, cluster=cluster, progress=progress)
        ranked = designs(plan, results, ANY_PART if any_part else None)
    best = best_designs(ranked)
    scenes = [design_scene(plan, original, design, k) for k, design in enumerate(best, 1)]
    said = [confirmed(one) for one in scenes]
    files = {}
    if output is not None:
        make_folder(output)
        for design, one in zip(best, scenes, strict=True):
            files[design.place] = str(Path(output) / f"{one.name}.toml")
            _write_scene(one, files[design.place])
    return Choice(original, ranked, best, said, scenes, files)


def scale(
    scene: str | Path | Scene,
    *,
    share: float = 0.5,
    opamp: str | None = None,
    supply: str | float | None = None,
    any_part: bool = False,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Scaled:
    """Propose G0, U0, s and R: outputs that use the swing, resistors that can be bought.

    Lambda, and with it the solution, stays. C changes only where the board would be unstable or
    fail its checks. The state-space engine verifies the result, which decides the exit status.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    share : float
        Highest output voltage of any op-amp, as a share of its swing.
    opamp : str, optional
        Preset in the place of the scene's op-amp.
    supply : str or float, optional
        Supply in the place of the scene's, as ±12V.
    any_part : bool
        Accept parts beyond the limits of real ones.
    output : path, optional
        Write the scene with the proposed scalings.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Scaled
        `scaling` with its scene, and the `verdict` on it.

    Raises
    ------
    InputError
        The scene, the op-amp or the supply cannot be used, or the file cannot be written.
    NoVerdictError
        No scalings are found, or the board has no verdict.

    Examples
    --------
    >>> import taction
    >>> taction.scale("scenes/tuned-breadboard.toml").outcome
    'pass'
    """
    from taction.netlist_gen.board.part_warnings import ANY_PART
    from taction.netlist_gen.scene.axes import with_values
    from taction.verification.design.scaling import Scaled
    from taction.verification.design.scaling import scale as run
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.verdict.verify import verify

    changes = {"design.opamp": opamp, "design.supply": supply}
    asked = with_values(read_scene(scene), {k: v for k, v in changes.items() if v is not None})
    progress("scalings")
    scaling = run(asked, share, accepted=ANY_PART if any_part else None)
    verdict = verify(scaling.scene.with_engine("statespace"), progress)
    if output is not None:
        _write_scene(scaling.scene, output)
    return Scaled.of(scaling, verdict)


def new(
    file: str | Path = "scene.toml",
    *,
    matrix: str | Path | None = None,
    strain: str | Path | None = None,
    noise: str | float | None = None,
    lam: float | None = None,
    opamp: str = "opa2134",
    supply: str | None = None,
    prune: float | None = None,
    any_part: bool = False,
    force: bool = False,
    progress: Progress = lambda stage: None,
) -> NewScene:
    """Write a scene to FILE (scene.toml): every key with its default and a comment.

    With --matrix and --strain: a scene for them, scaled for the op-amps, stable, and verified by
    the state-space engine, which decides the exit status.

    Parameters
    ----------
    file : path
        The scene file to write.
    matrix : path, optional
        Matrix T, .csv or .npy: a scene for it, with --strain.
    strain : path, optional
        Strain of the matrix, .csv or .npy.
    noise : str or float, optional
        Standard deviation of the noise of one strain, or 1% of the largest strain: lambda by the
        discrepancy rule.
    lam : float, optional
        Lambda; by default 0.01 times the squared norm of T, or by --noise.
    opamp : str
        Preset.
    supply : str, optional
        Supply as ±12V, with --matrix.
    prune : float, optional
        design.prune.
    any_part : bool
        Accept parts beyond the limits of real ones.
    force : bool
        Overwrite FILE.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    NewScene
        The files; with a matrix also the scaling and the verdict.

    Raises
    ------
    InputError
        A file exists or cannot be used, or an argument needs `matrix`.
    NoVerdictError
        No board for the matrix is found.

    Examples
    --------
    >>> import taction, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = taction.new(f"{folder}/board.toml")
    ...     taction.load_scene(made.file).name
    'board'
    """
    from taction.system.errors import Complaint, InputError

    path = Path(file)
    if (matrix is None) != (strain is None):
        missing = "--matrix" if matrix is None else "--strain"
        raise InputError(missing, Complaint("FILE", "", "--matrix and --strain belong together"))
    given = {"--noise": noise, "--lambda": lam, "--supply": supply, "--prune": prune}
    for option, value in given.items():
        if matrix is None and value is not None:
            raise InputError(option, Complaint("value", repr(value), "needs --matrix"))
    refuse_existing(path, force=force)
    from taction.netlist_gen.scene.open_tables import refuse_unknown

    refuse_unknown(opamp, "--opamp")
    if matrix is not None and strain is not None:  # what is wrong in the files is said at once
        from taction.netlist_gen.scene.problem_tables import problem_tables

        tables = problem_tables(Path(matrix), Path(strain))
    from taction.netlist_gen.scene.loading import load_scene
    from taction.system.atomic_files import write_atomically
    from taction.verification.design.fresh_scene import NewScene, fresh_scene
    from taction.verification.design.scaling import Scaled
    from taction.verification.verdict.verify import verify

    if matrix is None or strain is None:
        template = _template(opamp)
        stem = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in path.stem)
        write_atomically(path, template.replace("@NAME@", stem[:64] or "scene"))
        return NewScene(str(path), (str(path),))
    progress("scalings")
    design = {"opamp": opamp, "supply": supply, "prune": prune}
    fresh = fresh_scene(
        *tables,
        path,
        noise=noise,
        lam=lam,
        design={key: value for key, value in design.items() if value is not None},
        any_part=any_part,
    )
    for name in fresh.files:
        refuse_existing(name, force=force)
    for name, text in (*fresh.files.items(), (path, fresh.text)):
        write_atomically(name, text)
    verdict = verify(load_scene(path).with_engine("statespace"), progress)
    written = tuple(map(str, (*fresh.files, path)))
    return NewScene(str(path), written, fresh, Scaled.of(fresh.scaling, verdict))


def _template(opamp: str) -> str:
    """Return the scene with comments for an op-amp, at a supply that it allows."""
    from taction.netlist_gen.scene.open_tables import OPAMPS

    text = Path(__file__).with_name("scene_template.toml").read_text(encoding="utf-8")
    head, key, tail = text.partition('\nopamp = { base = "')
    text = f"{head}{key}{opamp}{tail[tail.index(chr(34)) :]}"
    if (volts := OPAMPS[opamp].most_supply) < 15.0:
        text = text.replace('\nsupply = "±15V"', f'\nsupply = "±{volts:g}V"')
    return text


def refuse_existing(path: Path, *, force: bool) -> None:
    """Refuse to write over a file, unless asked to.

    Raises
    ------
    InputError
        The file exists.
    """
    from taction.system.errors import Complaint, InputError

    if path.exists() and not force:
        text = "the file exists; give another name, or --force to overwrite it"
        raise InputError(path, Complaint("FILE", "", text))


def _write_scene(scene: Scene, output: str | Path) -> None:
    """Write a scene file; names of files in it are relative to its folder."""
    from taction.netlist_gen.scene.writing import scene_text
    from taction.system.atomic_files import write_atomically

    write_atomically(Path(output), scene_text(scene, Path(output).parent))
