"""Waveforms to a file: CSV, Parquet or ngspice raw, by the file's ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from taction.system.output_files import check_file, replacing

if TYPE_CHECKING:
    from taction.netlist_gen.board.circuit import Circuit
    from taction.system.array_types import Floats
    from taction.system.waveforms import Waveforms

PARQUET = "Parquet needs pyarrow: pip install 'taction[parquet]'; or write .csv or .raw"
PACKAGES = {".parquet": ("pyarrow", PARQUET)}


def check_export(path: str) -> None:
    """Refuse with InputError a file that could not be written, before any work is done.

    An unknown ending, a folder that does not exist, or Parquet without pyarrow.
    """
    check_file(path, "-o", WRITERS, PACKAGES)


def export(circuit: Circuit, waveforms: Waveforms, path: str) -> None:
    """Write `waveforms`: node voltages to ``.raw``, time and u_1, u_2, ... to the others.

    InputError: see `check_export`, or the file cannot be written.
    """
    check_export(path)
    with replacing(path) as file:
        WRITERS[Path(path).suffix.lower()](circuit, waveforms, file)


def _names(circuit: Circuit) -> list[str]:
    return ["time", *(f"u_{n}" for n in range(1, len(circuit.outputs) + 1))]


def _outputs(circuit: Circuit, waveforms: Waveforms) -> Floats:
    from taction.verification.verdict.companion import outputs

    return outputs(circuit, waveforms)


def _csv(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    import numpy as np

    table = np.column_stack([waveforms.time, _outputs(circuit, waveforms)])
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(_names(circuit)) + "\n")
        for row in table.tolist():
            file.write(",".join(map(repr, row)) + "\n")


def _parquet(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = [waveforms.time, *_outputs(circuit, waveforms).T]
    table = pyarrow.table(dict(zip(_names(circuit), columns, strict=True)))
    pyarrow.parquet.write_table(table, path)


def _raw(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    from taction.system.raw_file import write_raw

    write_raw(path, waveforms)


WRITERS: dict[str, Callable[[Circuit, Waveforms, Path], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".raw": _raw,
}
