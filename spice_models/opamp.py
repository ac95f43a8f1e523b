"""The op-amp macromodel as data: finite gain, two poles, input and output impedances."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class OpAmp:
    """Small-signal figures of one op-amp type, SI base units.

    The open-loop gain is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0`` and
    ``p2 = 2 pi second_pole``. Zero or infinite figures mean that the element is left out.

    Attributes
    ----------
    name : str
        Matches ``^[A-Za-z][A-Za-z0-9_]*$``; it becomes the subcircuit's name.
    dc_gain : float
        A0, V/V; finite and above 1.
    gbw : float
        Gain-bandwidth product, Hz; infinite: no first pole.
    second_pole : float
        Hz; infinite: no second pole.
    input_resistance : float
        Differential, ohm; infinite: none.
    differential_capacitance : float
        Between the inputs, F; 0: none.
    input_capacitance : float
        From each input to ground, F; 0: none.
    output_resistance : float
        Open loop, ohm; 0: none.
    source : str
        Where the figures were published.

    Raises
    ------
    ValueError
        For a figure that no op-amp has; the text names the figure, its value and what is accepted.
    """

    name: str
    dc_gain: float
    gbw: float = math.inf
    second_pole: float = math.inf
    input_resistance: float = math.inf
    differential_capacitance: float = 0.0
    input_capacitance: float = 0.0
    output_resistance: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"name = {self.name!r}: a letter, then letters, digits and '_'")
        if not 1.0 < self.dc_gain < math.inf:
            raise ValueError(f"dc_gain = {self.dc_gain!r}: finite and above 1")
        for figure in ("gbw", "second_pole", "input_resistance"):
            if not getattr(self, figure) > 0.0:
                raise ValueError(f"{figure} = {getattr(self, figure)!r}: above 0, or infinite")
        for figure in ("differential_capacitance", "input_capacitance", "output_resistance"):
            if not 0.0 <= getattr(self, figure) < math.inf:
                raise ValueError(f"{figure} = {getattr(self, figure)!r}: finite and not negative")
        if math.isinf(self.gbw) and math.isfinite(self.second_pole):
            raise ValueError(f"second_pole = {self.second_pole!r}: needs a finite gbw")

    @property
    def first_pole(self) -> float:
        """Dominant pole ``gbw / A0``, Hz; infinite where there is none."""
        return self.gbw / self.dc_gain


def unity_gain_bandwidth(opamp: OpAmp) -> float:
    """Frequency in Hz at which ``|A| = 1``; infinite for an op-amp without poles.

    With ``y = (f/f1)^2`` and ``r = (f1/f2)^2``, ``|A|^2 = 1`` is the quadratic
    ``r y^2 + (1 + r) y = A0^2 - 1``; its positive root is taken in the form without cancellation.
    """
    if math.isinf(opamp.gbw):
        return math.inf
    r = (opamp.first_pole / opamp.second_pole) ** 2
    excess = opamp.dc_gain**2 - 1.0
    y = 2.0 * excess / (1.0 + r + math.sqrt((1.0 + r) ** 2 + 4.0 * r * excess))
    return opamp.first_pole * math.sqrt(y)


def phase_margin(opamp: OpAmp) -> float:
    """180 degrees minus the phase lag of A at the unity-gain frequency, in degrees.

    An op-amp without poles has no lag: 180.
    """
    if math.isinf(opamp.gbw):
        return 180.0
    f_u = unity_gain_bandwidth(opamp)
    lag = math.atan(f_u / opamp.first_pole) + math.atan(f_u / opamp.second_pole)
    return 180.0 - math.degrees(lag)


def _relative_poles(dc_gain: float, margin: float) -> tuple[float, float]:
    """``(f_u/f1, f_u/f2)`` of a two-pole op-amp from its gain and phase margin (degrees).

    ``|A(f_u)| = 1`` with the phase ``-180 + margin`` says
    ``(1 + j a)(1 + j b) = A0 exp(j (180 - margin))``: the sum ``a + b = A0 sin(margin)`` and the
    product ``a b = 1 + A0 cos(margin)``, so both are roots of one quadratic.

    Raises
    ------
    ValueError
        If no pair of real poles has this margin.
    """
    angle = math.radians(margin)
    total, product = dc_gain * math.sin(angle), 1.0 + dc_gain * math.cos(angle)
    discriminant = total * total - 4.0 * product
    if not (0.0 < margin < 180.0 and product >= 0.0 and discriminant >= 0.0):
        most = math.degrees(math.acos(-1.0 / dc_gain))
        least = math.degrees(math.acos(1.0 - 2.0 / dc_gain))
        raise ValueError(
            f"phase_margin = {margin!r}: two real poles and a gain of {dc_gain!r} have between "
            f"{least:.4g} and {most:.4g} degrees"
        )
    a = (total + math.sqrt(discriminant)) / 2.0
    return a, product / a


def poles_from_phase_margin(
    dc_gain: float, unity_gain_bandwidth: float, phase_margin: float
) -> tuple[float, float]:
    """``(gbw, second_pole)`` in Hz from the figures that data sheets print.

    Parameters
    ----------
    dc_gain : float
        A0, V/V.
    unity_gain_bandwidth : float
        f_u with ``|A(f_u)| = 1``, Hz.
    phase_margin : float
        Degrees.

    Raises
    ------
    ValueError
        If no pair of real poles has this margin.
    """
    a, b = _relative_poles(dc_gain, phase_margin)
    second_pole = unity_gain_bandwidth / b if b > 0.0 else math.inf
    return dc_gain * unity_gain_bandwidth / a, second_pole


def second_pole_from_phase_margin(dc_gain: float, gbw: float, phase_margin: float) -> float:
    """Return the second pole in Hz that leaves `phase_margin` (degrees) at a given `gbw` (Hz).

    Raises
    ------
    ValueError
        If no pair of real poles has this margin, or `gbw` is infinite.
    """
    if math.isinf(gbw):
        raise ValueError(f"phase_margin = {phase_margin!r}: needs a finite gbw, not {gbw!r}")
    a, b = _relative_poles(dc_gain, phase_margin)
    return gbw / dc_gain * a / b if b > 0.0 else math.inf
