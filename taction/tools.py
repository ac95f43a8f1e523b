"""Jobs without a scene: a deck of another hand, op-amps, a vendor's model, and MCP."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.system.processes import one_limit

if TYPE_CHECKING:
    from taction.netlist_gen.board.opamp_choice import OpAmpFigures
    from taction.spice_models.opamp import OpAmp
    from taction.system.progress import Progress
    from taction.verification.studies.decks.board_check import BoardCheck
    from taction.verification.studies.decks.vendor_model import ImportedModel


def models() -> dict[str, OpAmp]:
    """List the op-amp presets; `show NAME` has one with all figures, measured beside stated.

    Returns
    -------
    dict of str to OpAmp
        The presets by name.

    Examples
    --------
    >>> import taction
    >>> taction.models()["tl084"].slew_rate
    13000000.0
    """
    from taction.netlist_gen.scene.open_tables import OPAMPS

    return dict(OPAMPS)


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
    from taction.netlist_gen.scene.fields import BOTH_SIGNS
    from taction.system.output_files import write_atomically
    from taction.verification.studies.decks.vendor_model import ImportedModel, import_opamp

    volts = _quantity("supply", BOTH_SIGNS.sub("", str(supply)), "V", 1e6)
    farads = _quantity("compensation", str(compensation), "F", 1.0) if compensation else 0.0
    name = re.sub(r"^(?![a-z])", "m", re.sub(r"[^a-z0-9]", "_", subckt.lower()))
    words = pins.split(",") if isinstance(pins, str) else pins
    roles = tuple(word.strip().lower() for word in words)
    found = to_document(name, import_opamp(str(file), subckt, roles, volts, farads))
    target = str(output or f"{name}.opamp.json")
    write_atomically(target, json.dumps(found, indent=1) + "\n")
    return ImportedModel(target, found)


def _quantity(name: str, text: str, unit: str, most: float) -> float:
    """Read a quantity of the option `name`, above zero."""
    from taction.system.errors import Complaint, InputError
    from taction.system.quantities import parse

    try:
        value = parse(text, unit)
        if not 0.0 < value <= most:
            raise ValueError(f"must be above zero, and at most {most:g} {unit}")
    except ValueError as error:
        raise InputError(f"--{name}", Complaint(name, repr(text), str(error))) from None
    return value


def mcp(folder: str | Path, *, limit: float = 300.0) -> None:
    """Answer calls of a program over stdin and stdout, by the Model Context Protocol.

    The tools are verify, check, onset, netlist, diff, models and model. A call takes the arguments
    of the command and returns the document of its --json. Files are read in FOLDER only; nothing is
    written. The server ends when stdin does.

    Parameters
    ----------
    folder : path
        The only folder of which files are read; names of files are relative to it.
    limit : float
        Time limit of a call, s.

    Raises
    ------
    InputError
        There is no such folder, or the SDK is missing (``taction[mcp]``).

    Examples
    --------
    The call ends when stdin is closed.

    >>> import taction
    >>> taction.mcp("scenes")  # doctest: +SKIP
    """
    from taction.verification.report.tool_server import serve

    serve(folder, limit)


def scene_schema() -> dict[str, Any]:
    """Return the JSON schema of scene files.

    Returns
    -------
    dict
        All keys with their types, defaults and descriptions.

    Examples
    --------
    >>> import taction
    >>> "capacitance" in taction.scene_schema()["$defs"]["Design"]["properties"]
    True
    """
    from taction.netlist_gen.scene.scene import scene_type

    return scene_type().model_json_schema(by_alias=True)


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
    from taction.verification.studies.decks.questions import wanted

    asked = wanted(_listed(checks), _listed(expect))
    from taction.verification.studies.decks.board_sweep import read_tolerances, swept_axis
    from taction.verification.studies.decks.foreign_board import read_board

    progress("deck")
    board, spread = read_board(deck, _listed(outputs)), None
    asked.refuse_unknown(board.flat.nodes)
    swept = [swept_axis(each, board) for each in _listed(over)]
    if tolerances is not None:
        spread = read_tolerances(tolerances, board.circuit)
    # all that can be refused is refused before the engine is loaded
    from taction.verification.studies.decks.board_check import check_board

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
