"""Waveforms to a file: CSV, Parquet or ngspice raw, by the file's ending."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np

from netlist_gen.board.circuit import Circuit
from spice_models.errors import Complaint, InputError
from verification.pipeline.simulation import outputs
from verification.waveforms import Waveforms


def check_export(path: str) -> None:
    """Refuse a file that could not be written, before any work is done.

    Raises
    ------
    InputError
        An unknown ending, a folder that does not exist, or Parquet without pyarrow.
    """
    file = Path(path)
    if file.suffix.lower() not in WRITERS:
        text = f"expected a file that ends in {', '.join(WRITERS)}"
        raise InputError("-o", Complaint("FILE", repr(path), text))
    if not file.parent.is_dir():
        raise InputError("-o", Complaint("FILE", repr(path), "its folder does not exist"))
    if file.suffix.lower() == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        text = "Parquet needs pyarrow: pip install 'taction[parquet]'; or write .csv or .raw"
        raise InputError("-o", Complaint("FILE", repr(path), text))


def export(circuit: Circuit, waveforms: Waveforms, path: str) -> None:
    """Write `waveforms`: node voltages to ``.raw``, time and u_1, u_2, ... to the others.

    Raises
    ------
    InputError
        See `check_export`; or the file cannot be written.
    """
    check_export(path)
    try:
        WRITERS[Path(path).suffix.lower()](circuit, waveforms, Path(path))
    except OSError as error:
        text = f"{error.strerror}; expected a file that can be written"
        raise InputError("-o", Complaint("FILE", repr(path), text)) from None


def _names(circuit: Circuit) -> list[str]:
    return ["time", *(f"u_{n}" for n in range(1, len(circuit.outputs) + 1))]


def _csv(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    table = np.column_stack([waveforms.time, outputs(circuit, waveforms)])
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(_names(circuit)) + "\n")
        for row in table.tolist():
            file.write(",".join(map(repr, row)) + "\n")


def _parquet(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = [waveforms.time, *outputs(circuit, waveforms).T]
    table = pyarrow.table(dict(zip(_names(circuit), columns, strict=True)))
    pyarrow.parquet.write_table(table, path)


def _raw(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    from verification.engines.ngspice.raw_file import write_raw

    write_raw(path, waveforms)


WRITERS: dict[str, Callable[[Circuit, Waveforms, Path], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".raw": _raw,
}
