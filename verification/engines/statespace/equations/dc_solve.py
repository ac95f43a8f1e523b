"""Solve the DC equations ``K z = r``: dense, or by the structured solve of a large board."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.structured_solve import Structure

Response = tuple[Callable[[Floats], Floats], Floats]
LOOSE = 1e17  # largest element of an inverse (rows scaled) that counts as regular


def dense_response(descriptor: Descriptor) -> Response:
    """Prepare the dense solution: ``r -> z``, and z (size, m) for a unit output of each amplifier.

    Raises
    ------
    EngineError
        K is singular: a node has no DC path, or a loop has no DC solution.
    """
    board = descriptor.dense
    K, halves = board.stiffness, board.halves
    inverses = [inverse for _, part in board.blocks if (inverse := _inverse(part)) is not None]
    if len(inverses) < len(board.blocks):
        raise _undetermined(K, descriptor.names)

    def unrefined(r: Floats) -> Floats:
        if halves is None:
            return inverses[0] @ r
        pairs = zip(inverses, halves.split_vectors(r), strict=True)
        return halves.join_vectors(*(inverse @ part for inverse, part in pairs))

    def solve(r: Floats) -> Floats:
        z = unrefined(r)
        return z + unrefined(r - K @ z)

    # -v_out + a = 0 in a device's row: a unit output is a right-hand side of -1.
    unit = np.zeros((descriptor.size, descriptor.devices.count))
    unit[descriptor.devices.output, np.arange(descriptor.devices.count)] = -1.0
    return solve, solve(unit) if unit.size else unit


def _inverse(K: Floats) -> Floats | None:
    """Invert K with scaled rows; return None if K is singular."""
    scale = np.abs(K).max(axis=1, initial=0.0)
    if not scale.all():
        return None
    try:
        inverse = np.linalg.inv(K / scale[:, None])
    except np.linalg.LinAlgError:
        return None
    return inverse / scale if np.abs(inverse).max(initial=0.0) < LOOSE else None


def _undetermined(K: Floats, names: tuple[str, ...]) -> EngineError:
    """Name a node that the DC equations do not determine."""
    scale = np.abs(K).max(axis=1)
    isolated = np.flatnonzero(scale == 0.0)
    if isolated.size:
        return EngineError(f"node {names[isolated[0]]!r} has no DC path to any other node")
    null_vector = np.linalg.svd(K / scale[:, None])[2][-1]
    worst = names[int(np.argmax(np.abs(null_vector)))]
    message = f"the DC equations do not determine node {worst!r} (no DC path, or no feedback)"
    return EngineError(message)


def structured_response(structure: Structure) -> Response:
    """Prepare the same by structured solves, one for each amplifier."""
    descriptor, solve_shifted = structure.descriptor, structure.factor(0.0).solve

    def solve(r: Floats) -> Floats:
        z = -solve_shifted(r)
        return np.asarray(z - solve_shifted(r - descriptor.stiffness_times(z)))

    columns = np.zeros((descriptor.size, descriptor.devices.count))
    for k, place in enumerate(descriptor.devices.output.tolist()):
        unit = np.zeros(descriptor.size)
        unit[place] = -1.0
        columns[:, k] = -solve_shifted(unit)
    return solve, columns
