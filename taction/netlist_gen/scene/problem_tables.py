"""A matrix and a strain from .csv or .npy files, whose shapes fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.array_files import read_table
from taction.netlist_gen.scene.problem import fitted
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError


@dataclass(frozen=True, slots=True)
class ProblemTable:
    """Numbers of a file as the scene needs them.

    `changed` says in words what differs from the file, which is then written anew; else empty.
    """

    path: Path
    values: Floats
    changed: str


def problem_tables(matrix: Path, strain: Path) -> tuple[ProblemTable, ProblemTable]:
    """Read a matrix (M, N), transposed where only that fits, and a strain (M,), or refuse them."""
    T, header = read_table(matrix, "problem.matrix")
    eps, other = read_table(strain, "problem.strain")
    try:
        T, eps = fitted(T, (None, None)), fitted(eps, (None,))
    except ValueError as error:
        wrong = strain if T.ndim == 2 and T.size else matrix
        swapped = wrong is strain and eps.ndim == 2 and min(eps.shape) > 1
        hint = "; are matrix and strain swapped?" if swapped else ""
        raise InputError(wrong, Complaint("numbers", "", f"{error}{hint}")) from None
    changes = ["the first row is a header"] if header else []
    if len(eps) != T.shape[0]:
        if len(eps) != T.shape[1]:
            text = (
                f"the matrix is {shape_text(T)} and the strain has {len(eps)} values; expected one"
                " value of strain for every row of T"
            )
            raise InputError(strain, Complaint("problem.strain", "", text))
        T = np.ascontiguousarray(T.T)
        changes.append(f"transposed, to {shape_text(T)}: the strain has {len(eps)} values")
    heads = "the first row is a header" if other else ""
    return ProblemTable(matrix, T, ", ".join(changes)), ProblemTable(strain, eps, heads)


def shape_text(T: Floats) -> str:
    """Return the numbers of rows and columns in words."""
    return f"{T.shape[0]} rows and {T.shape[1]} columns"
