"""The resistor matrices as cards, one a resistor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from taction.netlist_gen.board.circuit import ResistorMatrix
from taction.system.array_types import Floats


def matrix_lines(matrices: Iterable[ResistorMatrix]) -> list[str]:
    """Return one line per resistor, by matrices and rows: ``Rf_3_5`` is row 3, column 5."""
    lines: list[str] = []
    printed: dict[int, list[list[str]]] = {}  # forward and feedback resistors are one array
    for matrix in matrices:
        if id(matrix.ohms) not in printed:
            printed[id(matrix.ohms)] = _printed(matrix.ohms)
        for k, row in enumerate(printed[id(matrix.ohms)]):
            name = f"{matrix.name}_{k + 1}_"
            lines += [
                f"{name}{n} {drive} {sink} {ohms}"
                for n, (drive, sink, ohms) in enumerate(zip(*_ends(matrix, k), row, strict=True), 1)
                if ohms
            ]
    return lines


def _printed(ohms: Floats) -> list[list[str]]:
    """Return the text of every entry, "" if infinite; each distinct value is printed once."""
    values, places = np.unique(ohms, return_inverse=True)
    texts = np.array([repr(v) if v != math.inf else "" for v in values.tolist()], dtype=object)
    rows: list[list[str]] = texts[places].reshape(ohms.shape).tolist()
    return rows


def _ends(matrix: ResistorMatrix, k: int) -> tuple[Sequence[str], Sequence[str]]:
    """Return the driving and the summing nodes of row `k`."""
    signs = matrix.negative[k].tolist()
    if not matrix.by_column:
        ends = matrix.plus[k], matrix.minus[k]
        return [ends[sign] for sign in signs], matrix.sinks
    pairs = zip(matrix.plus, matrix.minus, signs, strict=True)
    drives = [minus if negative else plus for plus, minus, negative in pairs]
    return drives, [matrix.sinks[k]] * len(drives)
