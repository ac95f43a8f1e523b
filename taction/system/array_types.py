"""Types of arrays, whose users give shapes and units in their docstrings; the rounding unit.

`Waveforms` is what every engine returns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taction.system.quantities import quantity

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

EPS = float(np.finfo(np.float64).eps)  # distance of 1.0 to the next larger number

PHYSICAL_BOUND = 1e6
"""No node of a working board is above this voltage, V, with a unit voltage of 1 V."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a result: wall seconds, accepted time points and factorisations (0: unknown)."""

    seconds: float
    points: int
    factorisations: int = 0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Waveforms:
    """Node voltages over time.

    Attributes
    ----------
    time : ndarray (P,)
        Strictly increasing, s.
    nodes : tuple of str
        Names of the columns of `values`.
    values : ndarray (P, K)
        V; may be a view with any strides.
    engine : str
        Engine with its version (``"ngspice-46"``, ``"statespace"``).
    cost : Cost
        Time and steps of the run.
    flags : tuple of str
        Warnings of the engine that did not stop the run (a singular matrix that the solver got
        over, say); to be shown beside any verdict.
    rounding : float
        What the engine's own rounding left, V; 0 where the engine does not say.
    curve : callable or None
        Voltages of nodes (Q,), by column, at instants (Q,), s, also between the points; None where
        only the points are known.
    solver : str
        ngspice's matrix solver (``"KLU"``, ``"Sparse"``); empty for the other engine.
    method : str
        Integration method (``"trapezoidal"``, ``"gear"``, ``"Radau IIA"``), or ``"exact"``.
    fill : callable or None
        Returns the record with all its points, of one that has only its first and its last point.
    """

    time: Floats
    nodes: tuple[str, ...]
    values: Floats
    engine: str
    cost: Cost
    flags: tuple[str, ...] = ()
    rounding: float = 0.0
    curve: Callable[[Floats, Indices], Floats] | None = None
    solver: str = ""
    method: str = ""
    fill: Callable[[], Waveforms] | None = None

    @property
    def filled(self) -> Waveforms:
        """The record with all its points."""
        return self if self.fill is None else self.fill()

    @property
    def simulator(self) -> str:
        """Engine with its version, its matrix solver and its method, as far as they are known."""
        return ", ".join(filter(None, (self.engine, self.solver, self.method)))

    @property
    def spacing(self) -> float:
        """Largest distance of two instants, s."""
        return max((self.time[1:] - self.time[:-1]).tolist(), default=0.0)

    def __repr__(self) -> str:
        count, end = len(self.time), float(self.time[-1]) if len(self.time) else 0.0
        reach = f"{count} points to {quantity(end, 's')}"
        return f"Waveforms({len(self.nodes)} nodes, {reach}, {self.engine})"

    def __getitem__(self, node: str) -> Floats:
        """Return one node's voltage, shape (P,); KeyError for a node that was not saved."""
        try:
            return self.values[:, self.nodes.index(node)]
        except ValueError:
            raise KeyError(node) from None
