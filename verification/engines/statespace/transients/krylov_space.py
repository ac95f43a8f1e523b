"""Project a large board on a Krylov space: some forty states instead of thousands.

For ``M e' = K e`` (e is the deviation from the equilibrium) the charges ``q = M e`` follow
``q' = L q`` with ``(g - L)^-1 = M (g M - K)^-1``: applying that costs one structured solve at one
real shift g (see `structured_solve`). Arnoldi's method from q(0) gives m orthonormal vectors Q:

    M X = Q H + h q_next u^T,    X = (g M - K)^-1 Q,    u the last unit vector,

and ``q = Q y`` with ``y' = (g - H^-1) y``, ``e = X H^-1 y`` misses the equations in one direction:
``M e - q = h q_next eta`` and ``M e' - K e = h q_next (eta' - g eta)`` with ``eta = u^T H^-1 y``
(Moret and Novati, BIT 44 (2004) 595; van den Eshof and Hochbruck, SIAM J. Sci. Comput. 27 (2006)
1438). Any initial charges are valid, so no consistent initial state has to be found.
"""

from __future__ import annotations

import numpy as np

from spice_models.array_types import Floats, Ints
from verification.engines.statespace.equations.structured_solve import Structure
from verification.engines.statespace.transients.matrix_exponential import Exponentials

EXHAUSTED = 1e-13  # part of a vector outside the space, below which the space is complete
UNSTABLE = 1e-6  # growth over a record that is within the rounding of a pole on the axis


class Space:
    """A growing Krylov space of at most `largest` dimensions.

    `shift` is g, 1/s; `charge` (size,) is q(0), not all zero; `watch` (K,) are the unknowns whose
    waveforms are computed.
    """

    def __init__(
        self, structure: Structure, shift: float, charge: Floats, watch: Ints, largest: int
    ) -> None:
        self.mass, self.solve = structure.mass, structure.factor(shift).solve
        self.shift, self.watch, self.m = shift, watch, 0
        # Charges are scaled to voltages.
        self.weight = np.where(structure.capacitance > 0.0, structure.capacitance, 1.0)
        start = charge / self.weight
        self.size = float(np.linalg.norm(start))
        self.Q = np.zeros((largest + 1, len(charge)))
        self.H = np.zeros((largest + 1, largest))
        self.X = np.zeros((largest + 1, len(watch)))
        self.Q[0] = start / self.size
        self.image = self._apply(0)

    def _apply(self, j: int) -> Floats:
        """Return M x of ``x = (g M - K)^-1 q_j``, and store the watched elements of x."""
        x = self.solve(self.weight * self.Q[j])
        self.X[j] = x[self.watch]
        return np.asarray((self.mass @ x) / self.weight)

    def grow(self, count: int) -> bool:
        """Add `count` dimensions; return False where the space is complete with fewer."""
        for j in range(self.m, self.m + count):
            v, basis = self.image, self.Q[: j + 1]
            before = float(np.linalg.norm(v))
            for _ in range(2):  # a single pass loses orthogonality
                along = basis @ v
                v = v - along @ basis
                self.H[: j + 1, j] += along
            left, self.m = float(np.linalg.norm(v)), j + 1
            if left <= EXHAUSTED * before:
                return False
            self.H[j + 1, j] = left
            self.Q[j + 1] = v / left
            self.image = self._apply(j + 1)
        return True

    def ritz(self) -> Ritz:
        """Solve the projected equation; LinAlgError where its modes are defective."""
        m = self.m
        theta, V = np.linalg.eig(self.H[:m, :m])
        start, tail = np.zeros(m), np.zeros(m)
        start[0] = self.size
        # g h eta in volts: the residual after one more solve
        tail[-1] = self.shift * self.H[m, m - 1] * np.abs(self.X[m]).max(initial=0.0)
        rows = np.vstack([self.X[:m].T, tail])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = ((rows @ V) / theta * np.linalg.solve(V, start)).T
            poles = self.shift - 1.0 / theta.astype(np.complex128)
        # rightmost first; one of each conjugate pair is enough
        kept = [k for k in np.argsort(-poles.real) if theta[k].imag >= 0.0]
        pair = np.where(theta.imag[kept] > 0.0, 2.0, 1.0)
        return Ritz(poles[kept], share[kept] * pair[:, None])


class Ritz(Exponentials):
    """The transient of a Krylov space, V."""

    def stable(self, stop: float) -> bool:
        """Whether all values are finite and no pole is right of the axis, except by rounding."""
        if not (np.all(np.isfinite(self.poles)) and np.all(np.isfinite(self.share))):
            return False
        return bool(np.all(self.poles.real * stop <= UNSTABLE))
