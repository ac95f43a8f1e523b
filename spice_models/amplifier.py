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
        ``g`` as an ngspice B-source expression of ``x = v / Ve``; empty for the linear one,
        which is an op-amp and no behavioural source.
    biased : bool
        Whether a bias current I_b = Ve / R means something (entropy regulariser only).
    """

    name: str
    expression: str
    biased: bool


AMPLIFIERS: dict[str, AmplifierKind] = {
    kind.name: kind
    for kind in (
        AmplifierKind("linear", "", biased=False),
        AmplifierKind("exponential", "exp({x})", biased=True),
    )
}
