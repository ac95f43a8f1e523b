"""Jobs on a board without a study: its deck, its parts, its files, and its problem's solution."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.netlist_gen.scene.scene import Scene
    from taction.system.progress import Progress
    from taction.verification.reference.problem import Solution
    from taction.verification.verdict.board_files import BuiltBoard, Netlist, PartsList


def netlist(
    scene: str | Path | Scene,
    *,
    output: str | Path | None = None,
    dialect: str = "ngspice",
    measure: bool = False,
) -> Netlist:
    """Write the deck of SCENE; `ngspice -b -r out.raw FILE` runs it.

    The same scene gives the same bytes.

    Parameters
    ----------
    scene : path or Scene
        The board.
    output : path, optional
        Write the deck into this file; the command by default on stdout.
    dialect : {"ngspice", "ltspice", "hspice", "xyce", "spectre"}
        The simulator that reads the deck.
    measure : bool
        Add .meas cards of rise time, settling time, overshoot; `ngspice -b FILE` prints them.

    Returns
    -------
    Netlist
        Its `text` is the deck; `circuit.omissions` are the parts that the scene does not need.

    Raises
    ------
    InputError
        The scene cannot be used, the dialect cannot express it, or the file cannot be written.

    Examples
    --------
    >>> import taction
    >>> deck = taction.netlist("scenes/paper-breadboard.toml")
    >>> deck.saved
    ('v_1', 'v_2', 'v_3', 'v_4', 'v_5', 'v_6', 'v_7')
    """
    from taction.netlist_gen.deck.dialects import refuse_unable

    refuse_unable(dialect, measures=measure)
    from taction.system.output_files import write_atomically
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.verdict.board_files import deck_of

    deck = deck_of(read_scene(scene), dialect=dialect, measures=measure)
    if output is None:
        return deck
    write_atomically(output, deck.text)
    return replace(deck, written=(str(output),))


def bom(scene: str | Path | Scene, *, output: str | Path | None = None) -> PartsList:
    """List the parts of the board of SCENE: values, counts, references, packages, power.

    Parameters
    ----------
    scene : path or Scene
        The board.
    output : path, optional
        CSV file with KiCad's columns.

    Returns
    -------
    PartsList
        `parts` with their counts and packages, and `power` at rest.

    Raises
    ------
    InputError
        The scene cannot be built, or the file is no ``.csv`` or cannot be written.

    Examples
    --------
    >>> import taction
    >>> listed = taction.bom("scenes/tuned-breadboard.toml")
    >>> listed.parts.count("capacitor"), listed.parts.opamp
    (7, 'ideal')
    """
    from taction.system.output_files import check_file, is_special, write_atomically

    if output is not None and not is_special(output):
        check_file(str(output), "-o", {".csv": ""})
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.report.views.opamp_view import parts_csv
    from taction.verification.verdict.board_files import parts_list

    found = parts_list(read_scene(scene))
    if output is not None:
        write_atomically(output, parts_csv(found.parts))
    return found


def build(
    scene: str | Path | Scene,
    *,
    engine: str | None = None,
    output: str | Path,
    progress: Progress = lambda stage: None,
) -> BuiltBoard:
    """Write all that a builder of the board of SCENE needs, and verify the board.

    FOLDER gets the list of parts, a list of wires by pin, a KiCad project with all channels (KiCad
    8 or newer), the deck, and the report of the verdict. Without a verdict, the other files are
    written, too.

    Parameters
    ----------
    scene : path or Scene
        The board.
    engine : {"auto", "ngspice", "statespace"}, optional
        Engine in the place of the scene's own.
    output : path
        Folder, new or with the files of an earlier build, which are replaced.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    BuiltBoard
        `files`, `parts` and `verdict`, or why there is none: `refused`.

    Raises
    ------
    InputError
        The scene cannot be built, or the folder holds other files or cannot be written.

    Examples
    --------
    >>> import taction, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     built = taction.build("scenes/custom-matrix.toml", output=folder, engine="statespace")
    >>> built.outcome, built.files[:4]
    ('pass', ('report.html', 'parts.csv', 'wiring.csv', 'deck.cir'))
    """
    from taction.netlist_gen.board.bill_of_materials import bill_of_materials
    from taction.netlist_gen.board.synthesis import synthesise
    from taction.netlist_gen.kicad.board import kicad_project
    from taction.netlist_gen.kicad.part_symbols import BoardParts, wiring
    from taction.system.errors import TactionError
    from taction.system.output_files import (
        check_extra,
        check_own_folder,
        make_folder,
        write_together,
    )
    from taction.transients import verify
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.report.renderers.page import page_html
    from taction.verification.report.views.opamp_view import parts_csv
    from taction.verification.verdict.board_files import KICAD, OWN, REPORT, BuiltBoard, deck_of

    scene, place = read_scene(scene, engine), Path(output)
    check_extra("report", "-o")
    circuit = synthesise(scene)
    drawn = {f"{KICAD}/{name}": text for name, text in kicad_project(circuit, scene).items()}
    check_own_folder(place, [*OWN, *drawn])
    parts = bill_of_materials(circuit, scene)
    texts = {
        "parts.csv": parts_csv(parts),
        "wiring.csv": wiring(BoardParts(circuit, scene)),
    } | drawn
    verdict, refused, status = None, "", None
    try:
        texts["deck.cir"] = deck_of(scene).text
        verdict = verify(scene, progress=progress)
    except TactionError as error:
        refused, status = str(error), error.exit_status
    files = tuple(name for name in [*OWN, *drawn] if name in texts or name == REPORT)
    found = BuiltBoard(scene, str(place), files, parts, verdict, refused, status)
    texts[REPORT] = page_html(found.page())
    make_folder(place / KICAD)
    write_together({place / name: text for name, text in texts.items()})
    for name in OWN.keys() - texts.keys():
        (place / name).unlink(missing_ok=True)  # of an earlier board
    return found


@overload
def solve(scene: str | Path | Scene, *, strains: None = None) -> Solution: ...
@overload
def solve(scene: str | Path | Scene, *, strains: ArrayLike) -> list[Solution]: ...
def solve(
    scene: str | Path | Scene, *, strains: ArrayLike | None = None
) -> Solution | list[Solution]:
    """Solve the problem of SCENE numerically, without any circuit.

    Parameters
    ----------
    scene : path or Scene
        The problem: matrix, strain, amplifier and lambda.
    strains : array_like (K, M), optional
        Solve for each row instead of the scene's strain; the matrix is factorised once.

    Returns
    -------
    Solution or list of Solution
        `u` (N,), dimensionless, and its certificate; use it only if `trusted`, else see `reason`.
        With `strains`: one solution per row.

    Raises
    ------
    InputError
        The scene or the strains cannot be used.
    NoVerdictError
        No solution can be computed.

    Examples
    --------
    >>> import taction
    >>> scene = taction.Scene.from_arrays([[2.0, 0.0], [0.0, 1.0]], [4.0, 3.0], lam=1.0)
    >>> taction.solve(scene).u.round(12).tolist()
    [1.6, 1.5]
    """
    from taction.netlist_gen.scene.inverse_problem import make_problem, with_strains
    from taction.verification.reference.ideal_answer import ideal_network
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.reference.solve import solve_each

    scene = read_scene(scene)
    network = ideal_network(make_problem(scene), scene)
    if strains is None:
        return network.rest
    return solve_each(network.problem, [inverse.strain for inverse in with_strains(scene, strains)])
