"""A scene for a matrix and a strain from files: lambda chosen, scaled, stable and verified."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taction.netlist_gen.scene.array_files import read_table
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.problem import fitted
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.netlist_gen.scene.writing import scene_text
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError, SolverError
from taction.verification.design.fresh_limits import BAND, WANTED, with_limits
from taction.verification.design.fresh_pruning import Pruning, pruning_for
from taction.verification.design.scaling import SHARE, Scaling, scale
from taction.verification.reference import Problem
from taction.verification.reference.lambda_choice import RuleInputs, choose

WIDTH = 98  # of a comment
LOOSE = {"steady_state": {"tolerance": WANTED}, "settling_time": {"band": BAND * WANTED}}
"""Checks while the scalings are searched; the limits of the scene follow from the scaled board."""
DEFAULT = 0.01  # lambda without a noise level, in squared spectral norms of T


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers of a file as the scene needs them.

    `changed` says in words what differs from the file, which is then written anew; else empty.
    """

    path: Path
    values: Floats
    changed: str


@dataclass(frozen=True, slots=True)
class FreshScene:
    """A new scene and the files that belong to it.

    Attributes
    ----------
    scaling : Scaling
        The scene, with its scalings; its file is the new one.
    text : str
        Text of the scene file.
    files : mapping of Path to str
        CSV files to write: tables that had a header, or that were transposed.
    rule : str
        How lambda was chosen.
    notes : tuple of str
        What was recognised in the files, and which entries of T are left out.
    """

    scaling: Scaling
    text: str
    files: Mapping[Path, str]
    rule: str
    notes: tuple[str, ...]


def fresh_scene(
    matrix: Path,
    strain: Path,
    output: Path,
    *,
    noise: float | None = None,
    lam: float | None = None,
    design: Mapping[str, Any] | None = None,
    share: float = SHARE,
) -> FreshScene:
    """Return a scene for a matrix (M, N) and a strain (M,) from .csv or .npy files.

    A matrix (N, M) is transposed; header rows are recognised.

    Parameters
    ----------
    output : Path
        The new scene file; names of files are relative to its folder.
    noise : float, optional
        Standard deviation of the noise in one entry of the strain: lambda follows from the
        discrepancy rule.
    lam : float, optional
        Lambda in the place of a rule. Without both it is `DEFAULT` times the squared norm of T.
    design : mapping, optional
        Keys of the scene's table ``[design]``. Without ``prune`` the entries of T are left out
        that do not move the solution (see `pruning_for`).
    share : float
        As in `scale`.

    Raises
    ------
    InputError
        A file cannot be read, the shapes do not fit, or no design has these numbers.
    SolverError
        The discrepancy rule finds no lambda for this noise.
    """
    first, second = _tables(matrix, strain)
    chosen, rule = _lambda(first.values, second.values, noise, lam)
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in output.stem)
    arrays = {"kind": "matrix", "matrix": first.values, "strain": second.values}
    asked = dict(design or {})
    pruning = Pruning()
    if "prune" not in asked:
        pruning = pruning_for(first.values, second.values, chosen)
        asked |= {"prune": pruning.fraction} if pruning.entries else {}
    data = {
        "name": name[:64] or "scene",
        "problem": arrays,
        "design": {"amplifier": "linear", **asked, "lambda": chosen},
        "checks": LOOSE,
    }
    scaling = scale(parse_scene(data, output), share)
    names, files = _placed({"matrix": first, "strain": second}, output)
    limited, limits = with_limits(scaling.scene)
    notes = [f"{t.path.name}: {t.changed}" for t in (first, second) if t.changed]
    notes += [pruning.note] if pruning.entries else []
    head = f"Scaled by taction for a matrix of {_shape(first.values)}; lambda: {rule}."
    text = _commented([head, *notes, f"Limits: {limits}."], with_values(limited, names))
    return FreshScene(scaling, text, files, rule, tuple(notes))


def _placed(tables: Mapping[str, Table], output: Path) -> tuple[dict[str, str], dict[Path, str]]:
    """Return the names of the tables by key, and the texts of files that are written anew."""
    names, files = {}, {}
    for key, table in tables.items():
        path = table.path
        if table.changed:
            path = output.with_name(f"{output.stem}-{key}.csv")
            files[path] = _csv(table.values)
        names[f"problem.{key}"] = Path(os.path.relpath(path, output.parent)).as_posix()
    return names, files


def _commented(remarks: list[str], scene: Scene) -> str:
    """Return the text of a scene file, with remarks at its head."""
    lines = [line for remark in remarks for line in textwrap.wrap(remark, WIDTH)]
    return "\n".join([*(f"# {line}" for line in lines), "", scene_text(scene)])


def _tables(matrix: Path, strain: Path) -> tuple[Table, Table]:
    T, header = read_table(matrix, "problem.matrix")
    eps, other = read_table(strain, "problem.strain")
    try:
        T, eps = fitted(T, (None, None)), fitted(eps, (None,))
    except ValueError as error:
        wrong = strain if T.ndim == 2 and T.size else matrix
        raise InputError(wrong, Complaint("shape", "", str(error))) from None
    changes = ["the first row is a header"] if header else []
    if len(eps) != T.shape[0]:
        if len(eps) != T.shape[1]:
            text = (
                f"the matrix is {_shape(T)} and the strain has {len(eps)} values; expected one"
                " value of strain for every row of T"
            )
            raise InputError(strain, Complaint("problem.strain", "", text))
        T = np.ascontiguousarray(T.T)
        changes.append(f"transposed, to {_shape(T)}: the strain has {len(eps)} values")
    heads = "the first row is a header" if other else ""
    return Table(matrix, T, ", ".join(changes)), Table(strain, eps, heads)


def _shape(T: Floats) -> str:
    return f"{T.shape[0]} rows and {T.shape[1]} columns"


def _lambda(T: Floats, eps: Floats, noise: float | None, lam: float | None) -> tuple[float, str]:
    """Return lambda with three digits, and how it was chosen."""
    square = float(np.linalg.norm(T, 2)) ** 2
    if not square:
        raise InputError("matrix", Complaint("problem.matrix", "0", "T is all zeros"))
    if lam is not None:
        return lam, "as given"
    if noise is None:
        return float(f"{DEFAULT * square:.2e}"), f"the default, {DEFAULT:g} |T|²"
    choice = choose(Problem(T, eps, 1.0), "discrepancy", RuleInputs(variance=noise**2))
    if choice.at_edge:
        raise SolverError(
            f"no lambda leaves a residual of a noise of {noise:g}: the largest strain is"
            f" {np.abs(eps).max():.3g}. Give the standard deviation of one entry, or a lambda"
        )
    value = float(f"{choice.solution.lam:.2e}")
    return value, f"by the discrepancy rule, noise {noise:g}"


def _csv(values: Floats) -> str:
    rows = values.reshape(len(values), -1).tolist()
    return "".join(",".join(map(repr, row)) + "\n" for row in rows)
