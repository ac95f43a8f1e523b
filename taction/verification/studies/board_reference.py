"""What a deck that recovers u from ``eps = T u + noise`` should show: the regularised optimum."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.problem_tables import problem_tables
from taction.system.errors import Complaint, InputError
from taction.system.quantities import parse
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from taction.verification.studies.questions import share_of
from taction.verification.studies.wanted_checks import Expected


def reference_values(
    nodes: Sequence[str],
    matrix: str | Path,
    strain: str | Path,
    lam: float = 0.0,
    unit: str = "1V",
    accept: str = "0.1%",
) -> tuple[tuple[Expected, ...], tuple[str, ...]]:
    """Return the expected voltages of nodes, one of every channel, and what is to be said.

    Parameters
    ----------
    matrix, strain : path
        T (M, N) and eps (M,): .csv or .npy.
    lam : float
        Weight of ``|u|^2``; 0 for least squares.
    unit : str
        Voltage of ``u = 1``; negative for outputs that are inverted.
    accept : str
        Accepted deviation of an output, as a share of the largest one.

    Raises
    ------
    InputError
        A file or a value cannot be used, the numbers of channels and of nodes differ, or the
        problem has no certain solution.
    """
    T, eps = problem_tables(Path(matrix), Path(strain))
    channels = T.values.shape[1]
    if len(nodes) != channels:
        text = (
            f"the matrix has {channels} columns, and {len(nodes)} outputs are looked at"
            f" ({', '.join(nodes[:20])}); give one --output for each column, in their order"
        )
        raise InputError(matrix, Complaint("--matrix", "", text))
    try:
        volts = parse(unit, "V")
    except ValueError as error:
        raise InputError("--unit", Complaint("VOLTS", repr(unit), str(error))) from None
    found = solve(Problem(T.values, eps.values, lam))
    if not found.trusted:
        text = f"the optimum is not certain: {found.reason}; give a larger --lambda"
        raise InputError(matrix, Complaint("--lambda", f"{lam:g}", text))
    wanted = volts * found.u
    largest = float(np.abs(wanted).max(initial=0.0))
    tolerance = share_of(accept, "--accept") * largest - abs(volts) * found.error_bound
    notes = tuple(f"{each.path.name}: {each.changed}" for each in (T, eps) if each.changed)
    every = zip(nodes, wanted.tolist(), strict=True)
    return tuple(Expected(node, value, tolerance) for node, value in every), notes
