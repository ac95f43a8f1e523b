"""What a deck that recovers u from ``eps = T u + noise`` should show: the regularised optimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.problem_tables import problem_tables
from taction.system.errors import Complaint, InputError
from taction.system.quantities import parse
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from taction.verification.studies.wanted_checks import Expected, share_of


@dataclass(frozen=True, slots=True)
class BoardReference:
    """The problem that a deck is to solve, as files and texts.

    Attributes
    ----------
    matrix, strain : path
        T (M, N) and eps (M,): .csv or .npy.
    lam : float
        Weight of ``|u|^2``; 0 for least squares.
    unit : str
        Voltage of ``u = 1``; negative for outputs that are inverted.
    accept : str
        Accepted deviation of an output, as a share of the largest one.
    """

    matrix: str | Path
    strain: str | Path
    lam: float = 0.0
    unit: str = "1V"
    accept: str = "0.1%"

    def expected(self, nodes: Sequence[str]) -> tuple[tuple[Expected, ...], tuple[str, ...]]:
        """Return the expected voltages of nodes, one of every channel, and what is to be said.

        Raises
        ------
        InputError
            A file or a value cannot be used, the numbers of channels and of nodes differ, or the
            problem has no certain solution.
        """
        T, eps = problem_tables(Path(self.matrix), Path(self.strain))
        channels = T.values.shape[1]
        if len(nodes) != channels:
            listed = ", ".join(nodes[:20])
            text = (
                f"the matrix has {channels} columns, and {len(nodes)} outputs are looked at"
                f" ({listed}); give one --output for each column, in their order"
            )
            raise InputError(self.matrix, Complaint("--matrix", "", text))
        try:
            volts = parse(self.unit, "V")
        except ValueError as error:
            raise InputError("--unit", Complaint("VOLTS", repr(self.unit), str(error))) from None
        found = solve(Problem(T.values, eps.values, self.lam))
        if not found.trusted:
            text = f"the optimum is not certain: {found.reason}; give a larger --lambda"
            raise InputError(self.matrix, Complaint("--lambda", f"{self.lam:g}", text))
        wanted = volts * found.u
        largest = float(np.abs(wanted).max(initial=0.0))
        share = share_of(self.accept, "--accept")
        tolerance = share * largest - abs(volts) * found.error_bound
        notes = (f"{each.path.name}: {each.changed}" for each in (T, eps) if each.changed)
        return (
            tuple(Expected(n, v, tolerance) for n, v in zip(nodes, wanted.tolist(), strict=True)),
            tuple(notes),
        )
