"""Signal amplifiers: the increasing functions ``u = U0 g(v / Ve)`` of the signal plane.

One entry of `AMPLIFIERS` a kind. The regulariser that each brings to the energy is
``integral of g^-1`` (eq 17); see `verification.reference` for the solver's side of it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AmplifierKind:
    """One kind of signal amplifier.

    Attributes
    ----------
    name : str
        As a scene names it.
    expression : str
        ``g`` as an ngspice B-source expression of ``{x}``, which stands for ``v / Ve``; a product
        or a call, so that a minus sign before it negates all of it. Empty for the linear one,
        which is an op-amp and no behavioural source.
    biased : bool
        Whether a bias current I_b = Ve / R flows where the scene does not say: with exponential
        amplifiers it turns ``sum (u log u - u)`` into the entropy.
    """

    name: str
    expression: str
    biased: bool


# Above x = 30 the exponential goes on along its tangent, as diode models do: continuous with its
# slope, so Newton's iteration comes back from an overshoot in one step instead of one unit of x a
# step, and increasing, so no false equilibrium appears. Below, where u <= 1e13 U0, it is exact.
# Measured on 64 operating points (15 channels, lam 1 to 1e-6, ideal and real op-amps, ngspice 46):
# all 64 right; with the tangent from x = 60 62, from 100 58; exp(min(x, 200)) 61 and one wrong;
# a bare exp(x) 45, and 18 wrong answers with a result file (its overflow is clamped).
_EXPONENTIAL = "exp(min({x},30))*(1+max({x}-30,0))"

# The same for sinh, on both sides: beyond 30, tanh(30) is 1 to the last digit.
_SINH = "sinh(max(min({x},30),-30))*(1+max(abs({x})-30,0))"

# Smooth where a board starts: with max({x},0) and abs({x}) the derivative at 0 is wrong, and a step
# from there does not converge. Below -36 it is 0, which is right to 1e-16 of U0.
_SOFTPLUS = "(ln(1+exp(min({x},30)))+max({x}-30,0))"

AMPLIFIERS: dict[str, AmplifierKind] = {
    kind.name: kind
    for kind in (
        AmplifierKind("linear", "", biased=False),
        AmplifierKind("exponential", _EXPONENTIAL, biased=True),
        AmplifierKind("sinh", _SINH, biased=False),
        AmplifierKind("softplus", _SOFTPLUS, biased=False),
        AmplifierKind("tanh", "tanh({x})", biased=False),
    )
}
