"""The ideal network: the problem with the units of its voltages and of its time.

``C dv/dt = -v/R - I_b - s G0 T^T (G0 T u - G0 U0 eps)``, ``u = U0 g(v/Ve)`` (eq 9 as corrected). In
``x = v/Ve`` and ``t/(R C)`` this is ``dx = -(x + beta) - T^T (T g(x) - eps) / mu``: of all its
components only mu, a multiple of lambda, is left.
"""

from __future__ import annotations

from dataclasses import dataclass

from taction.system.array_types import Floats
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS


@dataclass(frozen=True, slots=True, eq=False)
class IdealNetwork:
    """A problem as a network with ideal op-amps; it has no components."""

    T: Floats  # (M, N)
    eps: Floats  # (M,)
    lam: float  # regularisation parameter
    RC: float  # time constant of a signal node, s
    U0: float = 1.0  # unit voltage, V
    amplifier: str = "linear"  # a key of `REGULARISERS`
    Ve: float = 1.0  # slope of a nonlinear amplifier, V; unused by the linear amplifier
    bias: bool = False  # whether ``I_b = Ve / R`` flows

    @property
    def unit(self) -> float:
        """Voltage at which ``x = 1``: Ve, and U0 for a linear amplifier, V."""
        return self.U0 if self.amplifier == "linear" else self.Ve

    @property
    def mu(self) -> float:
        """Lambda for linear amplifiers, half of lambda for the others."""
        return self.lam * REGULARISERS[self.amplifier].weight

    @property
    def problem(self) -> Problem:
        """Problem that the network's rest state solves."""
        return Problem(self.T, self.eps, self.lam, self.amplifier, self.bias)


def lambda_times_resistance(
    amplifier: str, *, s: float, G0: float, U0: float = 1.0, Ve: float = 1.0
) -> float:
    """Return the product of lambda and the feedback resistor R of a board, ohm.

    In the equation of the network above ``mu = unit / (R s G0^2 U0)``, where `unit` is U0 for
    linear amplifiers and Ve for all others; ``lambda = mu / weight``, with the weight of eq (8) or
    (21) as corrected. The synthesis of the board has a formula of its own for the same product.

    Parameters
    ----------
    amplifier : str
        A key of `REGULARISERS`.
    s : float
        Gain of the constraint plane, ohm.
    G0 : float
        Unit conductance, S.
    U0, Ve : float
        Unit voltage and slope of the amplifier, V.
    """
    volts = 1.0 if amplifier == "linear" else Ve / U0
    return volts / REGULARISERS[amplifier].weight / G0 / G0 / s
