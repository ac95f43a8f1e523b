"""The inverse problem of a scene: T, the strain, and the true stress where it is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from netlist_gen.problem.array_files import read_array, read_profile
from netlist_gen.scene.arrays import fitted
from netlist_gen.scene.problem import (
    CsvLoad,
    CylinderLoad,
    MatrixProblem,
    Noise,
    TactileProblem,
)
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError

ROUNDING = 16 * np.finfo(float).eps


@dataclass(frozen=True, slots=True, eq=False)
class InverseProblem:
    """``strain = matrix @ stress + noise``, dimensionless.

    Attributes
    ----------
    matrix : ndarray (M, N)
        T.
    strain : ndarray (M,)
        eps, noise included.
    stress : ndarray (N,) or None
        The truth, where the scene knows it.
    positions : ndarray (N,) or None
        y of the channels, tactile problems only.
    """

    matrix: Floats
    strain: Floats
    stress: Floats | None
    positions: Floats | None


def make_problem(scene: Scene) -> InverseProblem:
    """Build the inverse problem that `scene` describes.

    Raises
    ------
    InputError
        A file has a hole, a wrong shape, values that are not finite, or T is all zeros.
    """
    if isinstance(scene.problem, MatrixProblem):
        problem = _from_files(scene, scene.problem)
    else:
        problem = _tactile(scene, scene.problem)
    if not problem.matrix.any():
        raise InputError(
            scene.file, Complaint("problem", "", "T is all zeros; it needs an entry that is not")
        )
    return problem


def with_strains(scene: Scene, strains: ArrayLike) -> list[InverseProblem]:
    """Return the problem of `scene` with each row of `strains` (K, M) in the place of its strain.

    The scene's noise is not added to them, and the true stress is not known.

    Raises
    ------
    InputError
        As `make_problem`; also strains of another shape, or with an entry that is not finite.
    """
    problem = make_problem(scene)
    try:
        rows = fitted(np.asarray(strains, dtype=np.float64), (None, len(problem.strain)))
    except ValueError as error:
        text = f"{error} (one row a strain, one column a row of T)"
        raise InputError("strains", Complaint("strains", "", text)) from None
    return [replace(problem, strain=row, stress=None) for row in rows.copy()]


def kernel(
    offset: Floats, *, depth: float, modulus: float, poisson: float, tangential: bool = False
) -> Floats:
    """Strain at `depth` per unit of surface stress at a lateral `offset` (any shape).

    Normal stress: eq (2) with ``(1 - nu²) x²`` in place of the printed ``(1 - nu)² x²`` (only
    this gives eq (19) at nu = 0.5). Tangential stress: eq (3), ``offset / depth`` times that.
    A value within rounding of the kernel's own zero is zero: no resistor, rather than a huge one.
    """
    near = (1 - poisson**2) * depth**2
    far = poisson * (1 + poisson) * offset**2
    difference = near - far
    difference = np.where(np.abs(difference) <= ROUNDING * (near + np.abs(far)), 0.0, difference)
    normal = 2 * depth * difference / (np.pi * modulus * (depth**2 + offset**2) ** 2)
    return normal * (offset / depth) if tangential else normal


def grid(points: int, span: float) -> Floats:
    """Positions y of `points` equally spaced points over `span`, centred on 0, shape (points,)."""
    if points == 1:
        return np.zeros(1)
    return span * (2 * np.arange(points) - (points - 1)) / (2 * (points - 1))  # -y[::-1] exactly


def cylinder_stress(y: Floats, load: CylinderLoad) -> Floats:
    """Stress under a cylinder at `y` (N,), eq (18); twice that where `load.normalised` (Hertz)."""
    a = load.half_width
    scale = load.force / (np.pi * a**2) * (2.0 if load.normalised else 1.0)
    return scale * np.sqrt(np.maximum(a**2 - (y - load.centre) ** 2, 0.0))


def _tactile(scene: Scene, problem: TactileProblem) -> InverseProblem:
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


def _from_files(scene: Scene, problem: MatrixProblem) -> InverseProblem:
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
