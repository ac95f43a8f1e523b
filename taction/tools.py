"""Jobs without a board: the op-amps, a vendor's model, the schema of scenes, and MCP."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taction.spice_models.opamp import OpAmp
    from taction.verification.characterise.characterise import OpAmpFigures
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
    from taction.verification.characterise.characterise import OpAmpFigures

    return OpAmpFigures.of(OPAMPS[name])


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

    from taction.netlist_gen.scene.fields import BOTH_SIGNS
    from taction.netlist_gen.scene.imported_opamps import to_document
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
