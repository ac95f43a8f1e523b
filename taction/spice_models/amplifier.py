"""Signal amplifiers: the increasing functions ``u = U0 g(v / Ve)`` of the signal plane.

Each kind adds its own regulariser to the energy, the integral of ``g^-1`` (eq 17);
`taction.verification.reference` has the solver's formulas.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Amplifier:
    """What another package offers as a signal amplifier: three descriptions of one function g.

    Each is derived by itself and read by one witness, so that a mistake in one of them shows as a
    disagreement of the witnesses.
    """

    deck: AmplifierKind  # for ngspice
    gain: object  # a `Gain` of the state-space engine (its `amplifier_gains`)
    regulariser: object  # a `Regulariser` of the reference solver (its `regularisers`)


@dataclass(frozen=True, slots=True)
class AmplifierKind:
    """One kind of signal amplifier, with the name that a scene uses.

    `expression` is ``g`` as an ngspice B-source expression of ``{x}``, which stands for ``v / Ve``;
    it is a product or a call, so that a minus sign before it negates the whole. It is empty for the
    linear kind, an op-amp. `biased` is the default for a bias current I_b = Ve / R: with
    exponential amplifiers the current turns ``sum (u log u - u)`` into the entropy. `ridge` tells
    that g has the slope 1 wherever it is not flat: then its regulariser contains a ridge term
    ``sum u^2 / 2``, which a resistor can remove
    (`design.ridge_share`).
    """

    name: str
    expression: str
    biased: bool
    ridge: bool = False


# Above x = 30 the exponential continues along its tangent, as in diode models. The slope is
# continuous, so Newton's iteration recovers from an overshoot in one step instead of one unit of x
# per step; the function increases, so no false equilibrium appears. Below, where u <= 1e13 U0, the
# expression is exact. Measured on 64 operating points (15 channels, lam 1 to 1e-6, ideal and real
# op-amps, ngspice 46): all 64 right; with the tangent from x = 60: 62, from 100: 58;
# exp(min(x, 200)): 61, one wrong; exp(x): 45, and 18 wrong results (ngspice clamps the overflow).
_EXPONENTIAL = "exp(min({x},30))*(1+max({x}-30,0))"

# The same for sinh on both sides; tanh(30) is 1 to the last digit.
_SINH = "sinh(max(min({x},30),-30))*(1+max(abs({x})-30,0))"

# Smooth at 0, where a board starts: with max({x},0) and abs({x}) the derivative at 0 is wrong, so
# a step from 0 does not converge. Below -36 the value is 0, right to 1e-16 of U0.
_SOFTPLUS = "(ln(1+exp(min({x},30)))+max({x}-30,0))"

# Of straight pieces, so both engines have them exactly; max and min stand in every dialect.
_DEADZONE = "(max({x}-1,0)-max(-1-{x},0))"
_RECTIFIER = "max({x},0)"
_SATURATION = "max(min({x},1),-1)"

KINDS: dict[str, AmplifierKind] = {
    kind.name: kind
    for kind in (
        AmplifierKind("linear", "", biased=False),
        AmplifierKind("exponential", _EXPONENTIAL, biased=True),
        AmplifierKind("sinh", _SINH, biased=False),
        AmplifierKind("softplus", _SOFTPLUS, biased=False),
        AmplifierKind("tanh", "tanh({x})", biased=False),
        AmplifierKind("deadzone", _DEADZONE, biased=False, ridge=True),
        AmplifierKind("rectifier", _RECTIFIER, biased=False, ridge=True),
        AmplifierKind("saturation", _SATURATION, biased=False, ridge=True),
    )
}
"""The kinds of taction by name; `netlist_gen.scene.open_tables.AMPLIFIERS` has those of others."""
