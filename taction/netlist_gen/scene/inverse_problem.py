"""The inverse problem of a scene: T, the strain, and the true stress if known.

Numbers come from CSV and NumPy files beside the scene; mistakes have row and column.
"""

from __future__ import annotations

import io
import re
import tokenize
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike

from taction.netlist_gen.scene.fields import LARGE, SMALL
from taction.netlist_gen.scene.problem_keys import (
    CsvLoad,
    CylinderLoad,
    MatrixProblem,
    Noise,
    StatedProblem,
    TactileProblem,
    fitted,
)
from taction.system.array_types import EPS, Floats
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded, read_text
from taction.system.quantities import number

ROUNDING = 16 * EPS
EXPECTED = (
    "expected numbers with '.' as the decimal point and ',' between them, as 1.5,2.5e-3; a header"
    " begins with '#'"
)
_PLACE = re.compile(r"at row (\d+), column (\d+)")  # of a text of `numpy.loadtxt`
DAMAGED = ValueError, SyntaxError, TypeError, tokenize.TokenError, RecursionError, MemoryError
"""What numpy raises for a file that is not one of its own."""


@dataclass(frozen=True, slots=True, eq=False)
class InverseProblem:
    """``strain = matrix @ stress + noise``, dimensionless."""

    matrix: Floats  # T, (M, N)
    strain: Floats  # eps with noise, (M,)
    stress: Floats | None  # true u, (N,), if known
    positions: Floats | None  # y of the channels, (N,); tactile problems only


def make_problem(scene: StatedProblem) -> InverseProblem:
    """Build the inverse problem that `scene` describes.

    InputError: a file has a missing value, a wrong shape or a value that is not finite; T is all
      zeros; or T, the strain or the stress leave the range in which products stay finite.
    """
    with np.errstate(all="ignore"):  # what is not finite is refused
        if isinstance(scene.problem, MatrixProblem):
            problem = _from_files(scene, scene.problem)
        else:
            problem = _tactile(scene, scene.problem)
    arrays = {"T": problem.matrix, "the strain": problem.strain, "the stress": problem.stress}
    for name, array in arrays.items():
        largest = 0.0 if array is None else float(np.abs(array).max(initial=0.0))
        if largest and not SMALL <= largest <= LARGE:  # also NaN
            text = (
                f"the largest entry of {name} is {largest:g}; expected 0, or a size between"
                f" {SMALL:g} and {LARGE:g}"
            )
            raise InputError(scene.file, Complaint("problem", "", text))
    if not problem.matrix.any():
        text = "T is all zeros; expected an entry that is not zero"
        raise InputError(scene.file, Complaint("problem", "", text))
    return problem


def with_strains(scene: StatedProblem, strains: ArrayLike) -> list[InverseProblem]:
    """Return the problem of `scene` with each row of `strains` (K, M) as its strain."""
    problem = make_problem(scene)
    try:
        rows = fitted(np.asarray(strains, dtype=np.float64), (None, len(problem.strain)))
    except ValueError as error:
        text = f"{error} (one row per strain, one column per row of T)"
        raise InputError("strains", Complaint("strains", "", text)) from None
    return [replace(problem, strain=row, stress=None) for row in rows.copy()]


def kernel(
    offset: Floats, *, depth: float, modulus: float, poisson: float, tangential: bool = False
) -> Floats:
    """Return the strain at `depth` per unit of surface stress at a lateral `offset` (any shape).

    Eq (2) with ``(1 - nu²) x²`` in place of the printed ``(1 - nu)² x²``, or eq (3). What is within
    rounding of a zero of the kernel is zero: no resistor instead of a huge one.
    """
    near = (1 - poisson**2) * depth**2
    far = poisson * (1 + poisson) * offset**2
    difference = near - far
    difference = np.where(np.abs(difference) <= ROUNDING * (near + np.abs(far)), 0.0, difference)
    normal = 2 * depth * difference / (np.pi * modulus * (depth**2 + offset**2) ** 2)
    return normal * (offset / depth) if tangential else normal


def grid(points: int, span: float) -> Floats:
    """Return `points` equally spaced positions y over `span`, centred on 0, (points,)."""
    if points == 1:
        return np.zeros(1)
    return span * (2 * np.arange(points) - (points - 1)) / (2 * (points - 1))  # -y[::-1] exactly


def cylinder_stress(y: Floats, load: CylinderLoad) -> Floats:
    """Return the stress under a cylinder at `y` (N,), eq (18); twice that if normalised (Hertz)."""
    a = load.half_width
    scale = np.float64(load.force) / (np.pi * a**2) * (2.0 if load.normalised else 1.0)
    return scale * np.sqrt(np.maximum(a**2 - (y - load.centre) ** 2, 0.0))


def _tactile(scene: StatedProblem, problem: TactileProblem) -> InverseProblem:
    sensors = problem.sensors or problem.channels
    y, at = grid(problem.channels, problem.span), grid(sensors, problem.span)
    matrix = kernel(
        at[:, None] - y[None, :],
        depth=problem.depth,
        modulus=problem.modulus,
        poisson=problem.poisson,
        tangential=problem.kernel == "tangential",
    )
    if problem.quadrature == "rectangle":
        matrix = matrix * (problem.span / max(problem.channels - 1, 1))
    if isinstance(problem.load, CsvLoad):
        place, profile = read_profile(scene, "problem.load.file", problem.load.file)
        stress = np.interp(y, place, profile, left=0.0, right=0.0)
    else:
        stress = cylinder_stress(y, problem.load)
    return InverseProblem(matrix, _noisy(matrix @ stress, problem.noise), stress, y)


def _from_files(scene: StatedProblem, problem: MatrixProblem) -> InverseProblem:
    matrix = read_array(scene, "problem.matrix", problem.matrix, (None, None))
    sensors, channels = matrix.shape
    strain = read_array(scene, "problem.strain", problem.strain, (sensors,))
    stress = None
    if problem.stress is not None:
        stress = read_array(scene, "problem.stress", problem.stress, (channels,))
    return InverseProblem(matrix, _noisy(strain, problem.noise), stress, None)


def _noisy(strain: Floats, noise: Noise) -> Floats:
    if noise.variance == 0:
        return strain
    draw = np.random.default_rng(noise.seed).normal(0.0, np.sqrt(noise.variance), strain.shape)
    return strain + draw


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
    """Read numbers separated by commas; empty lines, and what follows a #, are skipped."""
    try:
        file = io.StringIO(read_text(path, LARGEST))
        with warnings.catch_warnings(action="ignore"):  # without numbers: `fitted` refuses it
            return np.loadtxt(file, delimiter=",", converters=number, ndmin=2, quotechar='"')
    except UnusableFileError as error:
        text = f"{error}; expected numbers separated by commas"
    except ValueError as error:
        where = _PLACE.search(str(error))  # rows from 0, columns from 1
        text = "" if where is None else f"row {int(where[1]) + 1}, column {where[2]}: "
        text += f"{str(error.__cause__ or error).partition('; ')[0]}; {EXPECTED}"
    raise InputError(path, Complaint(key, repr(path.name), text))
