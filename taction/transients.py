"""Jobs that run the transient of a scene: simulate it, or verify it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from netlist_gen.scene.scene import Scene
    from taction.verdict import Verdict
    from verification.pipeline.clock import Progress
    from verification.pipeline.recording import Record


@overload
def simulate(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: None = None,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Record: ...
@overload
def simulate(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: ArrayLike,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> list[Record]: ...
def simulate(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: ArrayLike | None = None,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Record | list[Record]:
    """Run the transient of a scene and measure it; nothing is judged.

    Parameters
    ----------
    scene : path or Scene
        The board.
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"`` in the place of the scene's own engine.
    strains : array_like (K, M), optional
        Simulate for each row in the place of the scene's strain.
    output : path, optional
        Write the waveforms there: ``.csv``, ``.parquet`` or ``.raw``; not with `strains`.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Record or list of Record
        `waveforms` and `measurements`; with `strains` one record a row, in order.

    Raises
    ------
    InputError
        The scene, the strains or the file cannot be used.
    NoVerdictError
        The engine gave no result.

    Notes
    -----
    The record has as many time points as the scene's checks need.

    Examples
    --------
    >>> import taction
    >>> record = taction.simulate("scenes/tuned-breadboard.toml", engine="statespace")
    >>> record.measurements.channels[3].state.value
    'settled'
    >>> len(record.waveforms["v_4"]) == len(record.waveforms.time)
    True
    """
    from netlist_gen.problem.inverse_problem import with_strains
    from spice_models.errors import Complaint, InputError
    from verification.ideal.lambda_rule import read_scene
    from verification.pipeline.recording import record_transient
    from verification.report.verdict.waveform_files import check_export, export

    asked = read_scene(scene, engine)
    if strains is not None:
        if output is not None:
            text = "one file holds one transient; leave out output, or strains"
            raise InputError("output", Complaint("FILE", repr(str(output)), text))
        problems = with_strains(asked, strains)
        return [record_transient(asked, progress, problem=each) for each in problems]
    if output is not None:
        check_export(str(output))
    record = record_transient(asked, progress)
    if output is not None:
        export(record.circuit, record.waveforms, str(output))
    return record


@overload
def verify(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: None = None,
    progress: Progress = lambda stage: None,
) -> Verdict: ...
@overload
def verify(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: ArrayLike,
    progress: Progress = lambda stage: None,
) -> list[Verdict]: ...
def verify(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    strains: ArrayLike | None = None,
    progress: Progress = lambda stage: None,
) -> Verdict | list[Verdict]:
    """Simulate the board of a scene, solve its problem, compare and judge.

    Parameters
    ----------
    scene : path or Scene
        The board, its problem and the checks.
    engine : str, optional
        ``"auto"``, ``"ngspice"`` or ``"statespace"`` in the place of the scene's own engine.
    strains : array_like (K, M), optional
        Verify for each row in the place of the scene's strain.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Verdict or list of Verdict
        ``print(verdict)`` shows the table of the command; with `strains` one verdict a row, in
        order.

    Raises
    ------
    InputError
        The scene or the strains cannot be used.
    NoVerdictError
        No engine gave a result, or there is no trustworthy solution to compare with.

    Notes
    -----
    A failed check is not an exception: `outcome` is pass, fail or inconclusive. With `strains` the
    board stays as it is: a rule for lambda is applied to the scene's own strain.

    Examples
    --------
    >>> import taction
    >>> taction.verify("scenes/paper-breadboard.toml", engine="statespace")
    Verdict('paper-breadboard', pass, statespace)
    >>> scene = taction.Scene.from_arrays([[2.0, 0.5], [0.5, 1.0]], [1.0, 1.0], capacitance="1nF")
    >>> verdicts = taction.verify(scene, engine="statespace", strains=[[0.2, 0.1], [0.1, 0.3]])
    >>> [verdict.outcome.value for verdict in verdicts]
    ['pass', 'pass']
    """
    from netlist_gen.problem.inverse_problem import with_strains
    from taction.verdict import Verdict
    from verification.ideal.lambda_rule import read_scene
    from verification.verify import verify as run

    asked = read_scene(scene, engine)
    if strains is None:
        return Verdict.of(run(asked, progress))
    problems = with_strains(asked, strains)
    return [Verdict.of(run(asked, progress, problem=each)) for each in problems]
