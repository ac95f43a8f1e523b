"""A large board seen from its Krylov space: some forty states in place of thousands.

For ``M e' = K e`` (e is the deviation from the equilibrium) the charges ``q = M e`` follow
``q' = L q`` with ``(g - L)^-1 = M (g M - K)^-1``: applying that costs one structured solve at one
real shift g (see `structure`). Arnoldi's method from q(0) projects it on m orthonormal vectors,

    M X = Q H + h q_next u^T,    X = (g M - K)^-1 Q,    u the last unit vector,

and ``q = Q y`` with ``y' = (g - H^-1) y``, ``e = X H^-1 y`` misses the equations in one direction:
``M e - q = h q_next eta`` and ``M e' - K e = h q_next (eta' - g eta)`` with ``eta = u^T H^-1 y``
(Moret and Novati, BIT 44 (2004) 595; van den Eshof and Hochbruck, SIAM J. Sci. Comput. 27 (2006)
1438). Charges may begin anywhere, so nothing has to be made consistent at t = 0.
"""

from __future__ import annotations

import numpy as np

from spice_models.array_types import Floats, Ints
from verification.engines.statespace.equations.structured_solve import Structure
from verification.engines.statespace.transients.matrix_exponential import Exponentials

EXHAUSTED = 1e-13  # of a vector, left after orthogonalisation: the space is all there is
UNSTABLE = 1e-6  # growth over a whole record that is but rounding of a pole on the axis


class Space:
    """A Krylov space while it grows.

    Parameters
    ----------
    structure : Structure
        The board.
    shift : float
        g, 1/s.
    charge : ndarray (size,)
        q(0), not all zero.
    watch : ndarray of int (K,)
        Unknowns whose waveforms are wanted.
    largest : int
        Dimensions at most.
    """

    def __init__(
        self, structure: Structure, shift: float, charge: Floats, watch: Ints, largest: int
    ) -> None:
        self.mass, self.solve = structure.mass, structure.factor(shift).solve
        self.shift, self.watch, self.m = shift, watch, 0
        # Charges count as the voltages that they stand for.
        weight = abs(self.mass).max(axis=1).toarray().ravel()
        self.weight = np.where(weight > 0.0, weight, 1.0)
        start = charge / self.weight
        self.size = float(np.linalg.norm(start))
        self.Q = np.zeros((largest + 1, len(charge)))
        self.H = np.zeros((largest + 1, largest))
        self.X = np.zeros((largest + 1, len(watch)))
        self.Q[0] = start / self.size
        self.image = self._apply(0)

    def _apply(self, j: int) -> Floats:
        """Return M x of ``x = (g M - K)^-1 q_j``, and keep what is watched of x."""
        x = self.solve(self.weight * self.Q[j])
        self.X[j] = x[self.watch]
        return np.asarray((self.mass @ x) / self.weight)

    def grow(self, count: int) -> bool:
        """Add `count` dimensions; False, with fewer, where the space is exhausted."""
        for j in range(self.m, self.m + count):
            v, basis = self.image, self.Q[: j + 1]
            before = float(np.linalg.norm(v))
            for _ in range(2):  # once loses orthogonality
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
        """Solve the projected equation.

        Raises
        ------
        LinAlgError
            Its modes are defective.
        """
        m = self.m
        theta, V = np.linalg.eig(self.H[:m, :m])
        start, tail = np.zeros(m), np.zeros(m)
        start[0] = self.size
        # g h eta in volts: what one more solve would make of the residual
        tail[-1] = self.shift * self.H[m, m - 1] * np.abs(self.X[m]).max(initial=0.0)
        rows = np.vstack([self.X[:m].T, tail])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = ((rows @ V) / theta * np.linalg.solve(V, start)).T
            poles = self.shift - 1.0 / theta.astype(np.complex128)
        # rightmost first; of a conjugate pair one suffices
        kept = [k for k in np.argsort(-poles.real) if theta[k].imag >= 0.0]
        pair = np.where(theta.imag[kept] > 0.0, 2.0, 1.0)
        return Ritz(poles[kept], share[kept] * pair[:, None])


class Ritz(Exponentials):
    """The transient as a Krylov space has it, V."""

    def stable(self, stop: float) -> bool:
        """Whether all of it is finite and no pole right of the axis, but by rounding."""
        if not (np.all(np.isfinite(self.poles)) and np.all(np.isfinite(self.share))):
            return False
        return bool(np.all(self.poles.real * stop <= UNSTABLE))
