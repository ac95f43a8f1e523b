"""Solve linear equations by an inverse with scaled rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError

SINGULAR = 1e13  # condition number of an equilibrated matrix above which it counts as singular


class ScaledInverse:
    """Solver of ``A X = B``: an inverse with scaled rows, and one step of refinement."""

    def __init__(self, A: Floats) -> None:
        filled = A != 0.0
        decoupled = filled.diagonal().copy()
        np.fill_diagonal(filled, False)
        decoupled &= ~(filled.any(axis=0) | filled.any(axis=1))
        self.coupled = np.flatnonzero(~decoupled)
        self.diagonal = np.where(decoupled, A.diagonal(), 1.0)[:, None]
        scaled = A.take(self.coupled, axis=0).take(self.coupled, axis=1)
        scale = np.abs(scaled).max(axis=1, initial=0.0)
        scale[scale == 0.0] = 1.0
        self.scale = scale[:, None]
        self.scaled = scaled / self.scale
        try:
            self.inverse = np.linalg.inv(self.scaled)
        except np.linalg.LinAlgError:
            self.inverse = np.full_like(self.scaled, np.inf)
        self.largest = float(np.abs(self.inverse).max(initial=0.0))

    @property
    def condition(self) -> float:
        """Condition number of the scaled matrix in the row-sum norm; inf if singular."""
        norms = [np.abs(X).sum(axis=1).max(initial=1.0) for X in (self.scaled, self.inverse)]
        return float(norms[0] * norms[1])

    def solve(self, B: Floats, names: Sequence[str], failure: str) -> Floats:
        """Return X; for a singular A raise EngineError with the names of the unknowns."""
        if not self.largest < SINGULAR:
            listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
            raise EngineError(f"{failure}: {listed}")
        X = B / self.diagonal
        if self.coupled.size:
            right = B.take(self.coupled, axis=0) / self.scale
            Y = self.inverse @ right
            X[self.coupled] = Y + self.inverse @ (right - self.scaled @ Y)
        return X
