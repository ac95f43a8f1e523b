"""Jobs without a study: a board's deck, parts, files and solution, an op-amp, a deck."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, overload

from taction.system.processes import one_limit

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.netlist_gen.board.opamp_choice import OpAmpFigures
    from taction.netlist_gen.scene.fields import Unit
    from taction.netlist_gen.scene.scene import Scene
    from taction.system.progress import Progress
    from taction.verification.reference.problem import Solution
    from taction.verification.studies.decks.board_check import BoardCheck
    from taction.verification.studies.decks.vendor_model import ImportedModel
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
        Deck file; the command writes to stdout by default.
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
    from taction.system import output_files
    from taction.system.errors import TactionError
    from taction.transients import verify
    from taction.verification.reference.lambda_rule import read_scene
    from taction.verification.report.renderers.page import page_html
    from taction.verification.report.views.opamp_view import parts_csv
    from taction.verification.verdict.board_files import KICAD, OWN, REPORT, BuiltBoard, deck_of

    scene, place = read_scene(scene, engine), Path(output)
    output_files.check_extra("report", "-o")
    circuit = synthesise(scene)
    drawn = {f"{KICAD}/{name}": text for name, text in kicad_project(circuit, scene).items()}
    output_files.check_own_folder(place, [*OWN, *drawn])
    parts, wires = bill_of_materials(circuit, scene), wiring(BoardParts(circuit, scene))
    texts = {"parts.csv": parts_csv(parts), "wiring.csv": wires} | drawn
    verdict, refused, status = None, "", None
    try:
        texts["deck.cir"] = deck_of(scene).text
        verdict = verify(scene, progress=progress)
    except TactionError as error:
        refused, status = str(error), error.exit_status
    files = tuple(name for name in [*OWN, *drawn] if name in texts or name == REPORT)
    found = BuiltBoard(scene, str(place), files, parts, verdict, refused, status)
    texts[REPORT] = page_html(found.page())
    output_files.make_folder(place / KICAD)
    output_files.write_together({place / name: text for name, text in texts.items()})
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


def opamp(name: str) -> OpAmpFigures:
    """Show all figures of the op-amp NAME with their sources, and its open loop.

    Parameters
    ----------
    name : str
        A preset.

    Returns
    -------
    OpAmpFigures
        The figures of the data sheet; `plot` draws the open loop.

    Raises
    ------
    InputError
        There is no such preset.

    Examples
    --------
    >>> import taction
    >>> taction.opamp("ua741").opamp.name
    'ua741'
    """
    from taction.netlist_gen.scene.open_tables import OPAMPS, refuse_unknown

    refuse_unknown(name, "parts show")
    from taction.netlist_gen.board.opamp_choice import OpAmpFigures
    from taction.spice_models.presets import figure_origins

    found = OPAMPS[name]
    return OpAmpFigures(found, figure_origins(found.name))


def import_model(
    file: str | Path,
    *,
    subckt: str,
    pins: str | Sequence[str],
    supply: str | float = "15V",
    compensation: str | float = "",
    output: str | Path | None = None,
) -> ImportedModel:
    """Import the op-amp macromodel of a vendor's netlist FILE for scenes.

    Only known cards, devices and functions are accepted, and written anew. ngspice measures the
    model; its response becomes a linear model for the state-space engine.

    Parameters
    ----------
    file : path
        The netlist.
    subckt : str
        Name of the subcircuit in FILE.
    pins : str or sequence of str
        Role of each port in its order: inp, inn, vcc, vee, out; nc for a port that stays open,
        comp for both ports of a compensation capacitor.
    supply : str or float
        Both supply voltages, as ±15V.
    compensation : str or float
        Capacitor between the two ports comp, as 22pF.
    output : path, optional
        The file to write, to lie beside the scene; by default NAME.opamp.json.

    Returns
    -------
    ImportedModel
        The file that was written, and its content.

    Raises
    ------
    InputError
        The netlist, a pin or the supply cannot be used, or the file cannot be written.
    NoVerdictError
        ngspice is missing, or gives no result.

    Examples
    --------
    >>> import taction, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = taction.import_model(
    ...         "tests/data/fet100.cir",
    ...         subckt="FET100",
    ...         pins="inp,inn,vcc,vee,out",
    ...         output=f"{folder}/fet100.opamp.json",
    ...     )
    >>> made.model["name"]
    'fet100'
    """
    import json
    import re

    from taction.netlist_gen.board.opamp_choice import to_document
    from taction.netlist_gen.scene.fields import Unit
    from taction.system.output_files import write_atomically
    from taction.verification.studies.decks.vendor_model import ImportedModel, import_opamp

    volts = _quantity("supply", supply, Unit("V", both=True))
    farads = _quantity("compensation", compensation, Unit("F")) if compensation else 0.0
    name = re.sub(r"^(?![a-z])", "m", re.sub(r"[^a-z0-9]", "_", subckt.lower()))
    words = pins.split(",") if isinstance(pins, str) else pins
    roles = tuple(word.strip().lower() for word in words)
    found = to_document(name, import_opamp(str(file), subckt, roles, volts, farads))
    target = str(output or f"{name}.opamp.json")
    write_atomically(target, json.dumps(found, indent=1) + "\n")
    return ImportedModel(target, found)


def _quantity(option: str, value: str | float, unit: Unit) -> float:
    """Read the quantity of an option as scenes have it."""
    from taction.system.errors import Complaint, InputError

    try:
        return float(unit.check(value))
    except ValueError as error:
        raise InputError(f"--{option}", Complaint(option, repr(value), str(error))) from None


SECONDS = 60.0  # of all runs of ngspice of one check


@one_limit(SECONDS)
def check(
    deck: str | Path,
    *,
    outputs: str | Iterable[str] = (),
    checks: str | Iterable[str] = (),
    expect: str | Iterable[str] = (),
    linearise: bool = False,
    over: str | Iterable[str] = (),
    tolerances: str | Path | None = None,
    samples: int = 300,
    seed: int = 1,
    ngspice: bool = True,
    transient: bool = False,
    progress: Progress = lambda stage: None,
) -> BoardCheck:
    r"""Find poles, oscillation onset, settling and noise of the linear op-amp circuit in DECK.

    DECK is a SPICE deck (ngspice, LTspice, HSPICE), which nothing runs: ngspice expands it, and the
    state-space engine reads its parts. Transistors, op-amps of vendors and whatever else is not
    linear are measured by ngspice at the operating point; its .ac is the witness.

    Parameters
    ----------
    deck : path
        The deck.
    outputs : str or iterable of str
        Node of interest, such as out or v(out); may be given several times. By default those that
        the deck prints, plots or saves, else the node called out, else every node.
    checks : str or iterable of str
        Limit of a reading: settling=1ms@1%, rise=10us, overshoot=5%, undershoot=5%, noise=1mV,
        margin=2 (factor by which the value of any part may change; no gain or phase margin),
        stable, oscillates, agree=1e-3. A circuit has to be stable unless it has to oscillate.
    expect : str or iterable of str
        Expected voltage at rest: v(out)=1.25@0.1%.
    linearise : bool
        Without effect: whatever is not linear is always measured at the operating point.
    over : str or iterable of str
        Part or .param to change: C1=1p:1n, gain=2:4:50, or a part alone. Every crossing of
        stability is found, and the readings at every value.
    tolerances : path, optional
        TOML file of tolerances: resistor = "1%", and a table [parts] with R1 = "0.1%". The worst
        corners and the yield are found.
    samples : int
        Boards that are drawn within the tolerances.
    seed : int
        Seed of these boards.
    ngspice : bool
        Compare with ngspice's own small signal (.ac) of the deck.
    transient : bool
        Compare the step response of a linear deck with ngspice's transient, too.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    BoardCheck
        Poles with bounds, the parts that move them, readings of the outputs, noise, checks, worst
        corners and yield; `plot` draws the step response and the poles.

    Raises
    ------
    InputError
        The deck, a node, a check, a value or a tolerance cannot be used.
    NoVerdictError
        ngspice is missing, or the circuit has no equilibrium or no state space.

    Examples
    --------
    >>> import pathlib, taction, tempfile
    >>> text = "RC\nV1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n.end\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     place = pathlib.Path(folder, "rc.cir")
    ...     _ = place.write_text(text)
    ...     found = taction.check(place, checks="settling=5us@1%", ngspice=False)
    >>> found.outcome.value, round(found.poles.rightmost.real)
    ('pass', -1000000)
    """
    from taction.system.errors import Complaint, InputError

    if str(deck).endswith(".toml"):  # before the modules of decks are loaded
        text = "a scene; `taction verify` takes it; expected a SPICE deck, such as filter.cir"
        raise InputError(deck, Complaint("deck", "", text))
    from taction.verification.studies.decks.board_check import check_board
    from taction.verification.studies.decks.board_sweep import read_tolerances, swept_axis
    from taction.verification.studies.decks.foreign_board import read_board
    from taction.verification.studies.decks.questions import wanted

    asked = wanted(_listed(checks), _listed(expect))
    progress("deck")
    board = read_board(deck, _listed(outputs))
    asked.refuse_unknown(board.flat.nodes)
    swept = [swept_axis(each, board) for each in _listed(over)]
    spread = None if tolerances is None else read_tolerances(tolerances, board.circuit)
    return check_board(
        board,
        asked,
        ngspice=ngspice,
        transient=transient,
        over=swept,
        tolerances=spread,
        samples=(samples, seed),
        progress=progress,
    )


def _listed(given: str | Iterable[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)
