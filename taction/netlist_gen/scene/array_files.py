"""Numbers from CSV and NumPy files beside the scene; mistakes have line and column."""

from __future__ import annotations

import csv
import io
import math
import tokenize
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from taction.netlist_gen.scene.problem_keys import StatedProblem, fitted
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, read_bounded, read_text
from taction.system.quantities import number

EXPECTED = (
    "expected numbers with '.' as the decimal point and ',' between them, as 1.5,2.5e-3; a header"
    " begins with '#'"
)
DAMAGED = ValueError, SyntaxError, TypeError, tokenize.TokenError, RecursionError, MemoryError
"""What numpy raises for a file that is not one of its own."""


def read_array(
    scene: StatedProblem, key: str, name: str | Floats, shape: tuple[int | None, ...]
) -> Floats:
    """Return the array for `key` of `scene`, as `fitted`: from the file `name`, or itself."""
    if isinstance(name, str):
        return read_file(scene.folder / name, key, shape)
    return _fitted(name, scene.file, key, "", shape)


def read_file(path: Path, key: str, shape: tuple[int | None, ...]) -> Floats:
    """Return the array of a .csv or .npy file."""
    values = _read_npy(path, key) if path.suffix == ".npy" else _read_csv(path, key)
    return _fitted(values, path, key, repr(path.name), shape)


def read_problem(matrix: str | Path, strain: str | Path) -> tuple[Floats, Floats]:
    """Return the matrix (M, N) and the strain (M,) of two files."""
    T = read_file(Path(matrix), "problem.matrix", (None, None))
    return T, read_file(Path(strain), "problem.strain", (len(T),))


def _fitted(
    values: Floats, path: Path, key: str, text: str, shape: tuple[int | None, ...]
) -> Floats:
    try:
        return fitted(values, shape)
    except ValueError as error:
        raise InputError(path, Complaint(key, text, str(error))) from None


def read_profile(scene: StatedProblem, key: str, name: str) -> tuple[Floats, Floats]:
    """Read a stress profile: two columns, y (increasing) and stress."""
    table = read_array(scene, key, name, (None, 2))
    if np.any(np.diff(table[:, 0]) <= 0):
        line = int(np.argmax(np.diff(table[:, 0]) <= 0)) + 2
        complaint = Complaint(key, repr(name), f"row {line}: y must increase from row to row")
        raise InputError(scene.folder / name, complaint)
    return table[:, 0], table[:, 1]


def _read_npy(path: Path, key: str) -> Floats:
    """Read a .npy file of real numbers, which must have as many as its header says."""
    try:
        values = npy.read_array(io.BytesIO(read_bounded(path, LARGEST)), allow_pickle=False)
        if values.dtype.kind not in "iuf":
            raise ValueError(f"its type is {values.dtype}")
    except DAMAGED as error:
        said = " ".join(str(error).split())
        text = f"{said}; expected a .npy file of real numbers"
        raise InputError(path, Complaint(key, repr(path.name), text)) from None
    return values.astype(np.float64)


def _read_csv(path: Path, key: str) -> Floats:
    """Read numbers separated by commas."""
    rows: list[list[float]] = []
    for line, cells in _rows(path, key):
        rows.append(_numbers(cells, path, key, line))
        if len(rows[-1]) != len(rows[0]):
            text = f"line {line} has {len(rows[-1])} values, the first {len(rows[0])}; expected"
            text += " as many in every line"
            raise InputError(path, Complaint(key, repr(path.name), text))
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else 0)


def _rows(path: Path, key: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells of each line; empty lines and lines that start with # are skipped."""
    try:
        text = read_text(path, LARGEST)
        for line, cells in enumerate(csv.reader(io.StringIO(text, newline="")), start=1):
            if not cells or not "".join(cells).strip() or cells[0].lstrip().startswith("#"):
                continue
            yield line, cells
    except (ValueError, csv.Error) as error:  # ValueError: no such file, or binary data
        text = f"{error}; expected numbers separated by commas"
        raise InputError(path, Complaint(key, repr(path.name), text)) from None


def _numbers(cells: list[str], path: Path, key: str, line: int) -> list[float]:
    numbers = []
    for column, cell in enumerate(cells, start=1):
        problem = f"{cell.strip()!r} is not a finite number" if cell.strip() else "no value"
        try:
            value = number(cell)
        except ValueError as error:
            value = math.nan
            problem = problem if "float" in str(error) else str(error).partition("; expected")[0]
        if not math.isfinite(value):
            text = f"line {line}, column {column}: {problem}; {EXPECTED}"
            raise InputError(path, Complaint(key, repr(path.name), text))
        numbers.append(value)
    return numbers
