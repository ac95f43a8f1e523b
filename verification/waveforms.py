"""`Waveforms`: what every engine returns."""

from __future__ import annotations

from dataclasses import dataclass

from spice_models.array_types import Floats


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
    """

    time: Floats
    nodes: tuple[str, ...]
    values: Floats
    engine: str
    cost: Cost
    flags: tuple[str, ...] = ()
    rounding: float = 0.0

    @property
    def spacing(self) -> float:
        """Largest distance of two instants, s."""
        return max((self.time[1:] - self.time[:-1]).tolist(), default=0.0)

    def __repr__(self) -> str:
        count, end = len(self.time), float(self.time[-1]) if len(self.time) else 0.0
        return f"Waveforms({len(self.nodes)} nodes, {count} points to {end:.4g} s, {self.engine})"

    def __getitem__(self, node: str) -> Floats:
        """Return one node's voltage, shape (P,); KeyError for a node that was not saved."""
        try:
            return self.values[:, self.nodes.index(node)]
        except ValueError:
            raise KeyError(node) from None
