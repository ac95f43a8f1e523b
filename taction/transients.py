"""Jobs with one transient: simulate a scene, or verify it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, overload

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.netlist_gen.scene.scene import Scene
    from taction.verdict import Verdict
    from taction.verification.verdict.clock import Progress
    from taction.verification.verdict.recording import Record

AnyScene: TypeAlias = "str | Path | Scene"


@overload
def simulate(
    scene: AnyScene,
    *,
    engine: str | None = ...,
    strains: None = ...,
    output: str | Path | None = ...,
    progress: Progress = ...,
) -> Record: ...
@overload
def simulate(
    scene: AnyScene, *, engine: str | None = ..., strains: ArrayLike, progress: Progress = ...
) -> list[Record]: ...
def simulate(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: ArrayLike | None = None,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Record | list[Record]:
    """Run the transient of a scene and measure the waveforms, without any check.

    Parameters
    ----------
    scene : path or Scene
        The board.
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"`` in the place of the scene's own engine.
    strains : array_like (K, M), optional
        Simulate for each row instead of the scene's strain.
    output : path, optional
        Write the waveforms into this file: ``.csv``, ``.parquet`` or ``.raw``; not with `strains`.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Record or list of Record
        `waveforms` and `measurements`; with `strains`: one record per row.

    Raises
    ------
    InputError
        The scene, the strains or the file cannot be used.
    NoVerdictError
        The engine gave no result.

    Examples
    --------
    >>> import taction
    >>> record = taction.simulate("scenes/tuned-breadboard.toml", engine="statespace")
    >>> record.measurements.channels[3].state.value
    'settled'
    >>> len(record.waveforms["v_4"]) == len(record.waveforms.time)
    True
    """
    from taction.netlist_gen.scene.inverse_problem import with_strains
    from taction.system.errors import Complaint, InputError
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.report.verdict.waveform_files import check_export, export
    from taction.verification.verdict.recording import record_transient

    scene = read_scene(scene, engine)
    if strains is not None:
        if output is not None:
            text = "one file holds one transient; leave out output, or strains"
            raise InputError("output", Complaint("FILE", repr(str(output)), text))
        problems = with_strains(scene, strains)
        return [record_transient(scene, progress, problem=problem) for problem in problems]
    if output is not None:
        check_export(str(output))
    record = record_transient(scene, progress)
    if output is not None:
        export(record.circuit, record.waveforms, str(output))
    return record


@overload
def verify(
    scene: AnyScene, *, engine: str | None = ..., strains: None = ..., progress: Progress = ...
) -> Verdict: ...
@overload
def verify(
    scene: AnyScene, *, engine: str | None = ..., strains: ArrayLike, progress: Progress = ...
) -> list[Verdict]: ...
def verify(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: ArrayLike | None = None,
    progress: Progress = lambda stage: None,
) -> Verdict | list[Verdict]:
    """Simulate the board of a scene, solve its problem, and check the board against the solution.

    Parameters
    ----------
    scene : path or Scene
        The board, its problem and the checks.
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"`` in the place of the scene's own engine.
    strains : array_like (K, M), optional
        Verify for each row instead of the scene's strain, which still decides a lambda by a rule.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Verdict or list of Verdict
        ``print(verdict)`` shows the table of the command; `outcome` is pass, fail or inconclusive.
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
    >>> taction.verify("scenes/paper-breadboard.toml", engine="statespace").outcome.value
    'pass'
    >>> scene = taction.Scene.from_arrays([[2.0, 0.5], [0.5, 1.0]], [1.0, 1.0], capacitance="1nF")
    >>> verdicts = taction.verify(scene, engine="statespace", strains=[[0.2, 0.1], [0.1, 0.3]])
    >>> [verdict.outcome.value for verdict in verdicts]
    ['pass', 'pass']
    """
    from taction.netlist_gen.scene.inverse_problem import with_strains
    from taction.verdict import Verdict
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.verdict.verify import verify as verify_one

    scene = read_scene(scene, engine)
    if strains is None:
        return Verdict.of(verify_one(scene, progress))
    problems = with_strains(scene, strains)
    return [Verdict.of(verify_one(scene, progress, problem=problem)) for problem in problems]
