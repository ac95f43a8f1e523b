"""Outputs: refused before any work where they cannot be written; waveforms as CSV, Parquet, raw."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from taction.netlist_gen.scene.keys import files_of
from taction.netlist_gen.scene.scene import load_scene
from taction.system.errors import Complaint, InputError
from taction.system.output_files import check_file, is_special, replacing

if TYPE_CHECKING:
    from taction.netlist_gen.board.circuit import Circuit
    from taction.system.array_types import Floats, Waveforms


def check_separate(inputs: Iterable[str | None], outputs: Mapping[str, str]) -> None:
    """Refuse with InputError an output, by option, that would overwrite an input or another."""
    taken = {os.path.realpath(file): "an input" for name in inputs if name for file in _read(name)}
    for option, name in outputs.items():
        if is_special(name):
            continue
        place = os.path.realpath(name)
        if place in taken:
            text = f"{taken[place]} of the same command; expected another file"
            raise InputError(option, Complaint("FILE", repr(name), text))
        taken[place] = f"the file of {option}"


def _read(name: str) -> list[str | Path]:
    """Return the files that a command reads for its argument `name`."""
    path = Path(name)
    if path.is_dir():
        return [name, *path.glob("*.toml")]
    if path.suffix != ".toml":
        return [name]
    try:
        scene = load_scene(path)
    except InputError:  # the command itself will report the mistakes
        return [name]
    files = files_of(scene).values()
    return [name, *(scene.folder / file for file in files if isinstance(file, str))]


def check_export(path: str) -> None:
    """Refuse with InputError waveforms that could not be written, before any work is done."""
    check_file(path, "-o", {each: "parquet" * (each == ".parquet") for each in WRITERS})


def export(circuit: Circuit, waveforms: Waveforms, path: str) -> None:
    """Write node voltages to ``.raw``, time and u_1, u_2, ... to the others."""
    check_export(path)
    with replacing(path) as file:
        WRITERS[Path(path).suffix.lower()](circuit, waveforms, file)


def _columns(circuit: Circuit, waveforms: Waveforms) -> dict[str, Floats]:
    from taction.verification.verdict.run import outputs

    found = outputs(circuit, waveforms)
    named = {f"u_{n}": column for n, column in enumerate(found.T, 1)}
    return {"time": waveforms.time, **named}


def _csv(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    columns = _columns(circuit, waveforms)
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        csv.writer(file, lineterminator="\n").writerows([[*columns], *rows])


def _parquet(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(_columns(circuit, waveforms)), path)


def _raw(circuit: Circuit, waveforms: Waveforms, path: Path) -> None:
    from taction.system.raw_file import write_raw

    write_raw(path, waveforms)


WRITERS: dict[str, Callable[[Circuit, Waveforms, Path], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".raw": _raw,
}
