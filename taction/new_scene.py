"""A new scene: with comments, or for a matrix and a strain."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taction.system.progress import Progress
    from taction.verification.design.fresh_scene import NewScene


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
        from taction.netlist_gen.scene.array_files import problem_tables

        tables = problem_tables(Path(matrix), Path(strain))
    from taction.netlist_gen.scene.loading import load_scene
    from taction.system.output_files import write_atomically
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

    InputError: the file exists.
    """
    from taction.system.errors import Complaint, InputError

    if path.exists() and not force:
        text = "the file exists; give another name, or --force to overwrite it"
        raise InputError(path, Complaint("FILE", "", text))
