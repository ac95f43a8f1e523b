"""The op-amp macromodel as data: gain, poles, impedances, limits, noise and package."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from taction.spice_models.imported import ImportedOpAmp

BOLTZMANN = 1.380649e-23  # J/K
TEMPERATURE = 300.15  # K: 27 degrees C, ngspice's default
THERMAL = 4.0 * BOLTZMANN * TEMPERATURE
"""Spectral density for positive frequencies: V²/Hz of a resistance of 1 ohm, A²/Hz of 1 S."""


KNEE = 50.0
"""Swing over the width of the knee of a clamp. At 90 % of the swing the clamp draws 1e-4 of the
slew rate, which the loop replaces with some microvolts at the input."""
OVERDRIVE = 100.0
"""Beyond the largest output current, the voltage that doubles the current, in supply voltages: an
output that is overdriven by the whole supply gives 1 % more than its limit. Newton's method
converges on a steep drop from any start. A current source with flat ends made ngspice 46 fail
where an output entered its limit: the iteration alternates between both ends."""


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_ABOVE_ZERO = """
    gbw second_pole input_resistance slew_rate output_current common_mode_rejection bias_doubling
    supply_rejection
"""
_ZERO_OR_MORE = """
    differential_capacitance input_capacitance output_resistance voltage_noise current_noise
    supply_current offset_drift bias_drift voltage_noise_corner
"""
_SIGNED = "offset_voltage bias_current offset_current"
RANGES: dict[str, tuple[str, Callable[[float], bool]]] = {
    **dict.fromkeys(_ABOVE_ZERO.split(), ("above 0", lambda value: value > 0.0)),
    **dict.fromkeys(_ZERO_OR_MORE.split(), ("finite, 0 or more", lambda v: 0.0 <= v < math.inf)),
    **dict.fromkeys(_SIGNED.split(), ("finite", math.isfinite)),
}  # what the values of figures must be, in words and as a test


@dataclass(frozen=True, slots=True)
class Spread:
    """One input error, or its change, over all op-amps of a type: a normal distribution."""

    # V or A; of the common-mode error the voltage at the input over the common-mode voltage
    mean: float
    sigma: float
    assumed: bool = False  # whether the sheet has no largest size, or it is not confirmed


@dataclass(frozen=True, slots=True)
class OpAmp:
    """Figures of one op-amp type, SI base units.

    The open-loop gain is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0`` and
    ``p2 = 2 pi second_pole``. The defaults (infinite or zero) omit the element, and a part with the
    default limits has none.

    At the `large_signal` level the limits of slope and voltage are in the macromodel. Its input
    stage is ``V tanh(v / V)`` with ``V = input_range``, so the first pole's slope is at most the
    slew rate. A clamp draws ``slew_rate (tanh((x - swing)/d) + tanh((x + swing)/d))`` from the
    first pole's output x, with ``d = swing / KNEE``: it stops x at the swing. With
    `limits_current` there is, in series with the output resistance, the voltage drop
    ``U (softplus(K (y - 1)) - softplus(-K (y + 1))) / K`` of the output current i, with
    ``y = i / output_current``, ``K = 2 KNEE`` and U `OVERDRIVE` times the supply: nothing up to the
    largest current, and steep beyond it. Small signals see the same gain.

    With `input_errors` the DC errors of the inputs are in the macromodel: the gain acts on
    ``v+ - v- + offset_voltage + rejection_error (v+ + v-) / 2``, and the inputs draw the currents
    ``bias_current ± offset_current / 2``.

    Raises
    ------
    ValueError
        A figure is out of its range; the text has its name, its value and the accepted range.
    """

    DOCUMENT = (
        *("dc_gain", "gbw [Hz]", "second_pole [Hz]", "input_resistance [ohm]"),
        *("differential_capacitance [F]", "input_capacitance [F]", "output_resistance [ohm]"),
        *("slew_rate [V/s]", "output_current [A]", "saturation [V]", "least_supply [V]"),
        *("most_supply [V]", "voltage_noise [V/rtHz]", "current_noise [A/rtHz]"),
        *("supply_current [A]", "channels_per_package", "offset_voltage [V]", "bias_current [A]"),
        *("offset_current [A]", "common_mode_rejection [dB]", "source"),
    )

    name: str  # of the subcircuit: a letter, then letters, digits and '_'
    dc_gain: float  # A0, V/V; finite and above 1
    gbw: float = math.inf  # gain-bandwidth product, Hz
    second_pole: float = math.inf  # Hz
    input_resistance: float = math.inf  # differential, ohm
    differential_capacitance: float = 0.0  # between the inputs, F
    input_capacitance: float = 0.0  # from each input to ground, F
    output_resistance: float = 0.0  # open loop, ohm
    slew_rate: float = math.inf  # of the output, V/s
    output_current: float = math.inf  # largest, A; judged only with an output resistance
    saturation: float = -math.inf  # least distance of the output from a supply voltage, V
    least_supply: float = 0.0  # of each of the two supply voltages, V
    most_supply: float = math.inf
    voltage_noise: float = 0.0  # white, at the input of the gain stages, V/rtHz
    current_noise: float = 0.0  # white, into each input, A/rtHz
    voltage_noise_corner: float | None = None  # of its 1/f noise, Hz; None: not known
    supply_current: float = 0.0  # quiescent, of one op-amp, A
    offset_voltage: float = 0.0  # adds to v+, V
    bias_current: float = 0.0  # mean of the currents into the inputs, A
    offset_current: float = 0.0  # current into the non-inverting input less the other, A
    common_mode_rejection: float = math.inf  # dB
    offset_drift: float = 0.0  # typical size, of the offset voltage, V/K; 0: not known
    bias_drift: float = 0.0  # typical size, of the bias current, A/K; 0: not known
    bias_doubling: float = math.inf  # warming that doubles the input currents, K
    supply_rejection: float = math.inf  # offset voltage by both supply voltages, dB
    channels_per_package: int = 1  # op-amps in one package
    external_part: str = ""  # that every op-amp of the type needs beside it
    source: str = ""  # publication of the figures
    large_signal: bool = False  # whether the macromodel has slew rate and swing
    limits_current: bool = False  # whether it has the largest output current, too, if there is one
    input_errors: bool = False  # whether the macromodel has offset, bias and common-mode error
    rejection_sign: float = 1.0  # of the common-mode error
    guaranteed: tuple[tuple[str, float], ...] = ()  # limits of figures by the sheet, 25 degrees C
    # figures and limits ("guaranteed.NAME") that no document confirms
    assumed: tuple[str, ...] = ()
    # input errors and their changes (`input_errors.CHANGES`)
    varying: tuple[tuple[str, Spread], ...] = ()
    not_known: tuple[str, ...] = ()  # errors and changes that should be there, and no sheet has
    imported: ImportedOpAmp | None = None  # a vendor's macromodel in the place of ours

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"name = {self.name!r}: expected a letter, then letters, digits, '_'")
        if not 1.0 < self.dc_gain < math.inf:
            raise ValueError(f"dc_gain = {self.dc_gain!r}: must be finite and above 1")
        for figure, (accepted, is_good) in RANGES.items():
            value = getattr(self, figure)
            if value is not None and not is_good(value):
                raise ValueError(f"{figure} = {value!r}: must be {accepted}")
        if not (isinstance(self.channels_per_package, int) and self.channels_per_package >= 1):
            found = repr(self.channels_per_package)
            raise ValueError(f"channels_per_package = {found}: must be a whole number, 1 or more")
        if math.isinf(self.gbw) and math.isfinite(self.second_pole):
            raise ValueError(f"second_pole = {self.second_pole!r}: needs a finite gbw")
        if self.input_errors and math.isinf(self.gbw) and math.isfinite(self.output_current):
            text = "offset and input currents of an op-amp with a largest current need a finite gbw"
            raise ValueError(f"input_errors = True: {text}")
        if self.large_signal and not math.isfinite(self.input_range):
            raise ValueError("large_signal = True: needs a finite slew_rate and a finite gbw")

    @property
    def input_range(self) -> float:
        """Differential input voltage at which a linear input stage would give the slew rate, V."""
        return self.slew_rate / (2.0 * math.pi * self.gbw) if math.isfinite(self.gbw) else math.inf

    def swing(self, supply: float) -> float:
        """Return the largest output voltage of either sign, V, at supplies of ±`supply`, V."""
        return supply - self.saturation

    @property
    def input_offset(self) -> float:
        """Offset voltage in the macromodel, V."""
        return self.offset_voltage if self.input_errors else 0.0

    @property
    def input_currents(self) -> tuple[float, float]:
        """Currents into the non-inverting and the inverting input in the macromodel, A."""
        half = 0.5 * self.offset_current
        both = (self.bias_current + half, self.bias_current - half)
        return both if self.input_errors else (0.0, 0.0)

    @property
    def rejection_error(self) -> float:
        """Gain of the common-mode voltage over that of the difference, in the macromodel."""
        size = 10.0 ** (-self.common_mode_rejection / 20.0)
        return self.rejection_sign * size if self.input_errors else 0.0

    @property
    def small_signal(self) -> OpAmp:
        """The op-amp without limits in its macromodel."""
        return replace(self, large_signal=False, limits_current=False)

    @property
    def has_largest_current(self) -> bool:
        """Whether the part has a largest output current that can be judged."""
        return math.isfinite(self.output_current) and self.output_resistance > 0.0

    @property
    def is_current_limited(self) -> bool:
        """Whether the macromodel has a limit of the output current."""
        return self.large_signal and self.limits_current and self.has_largest_current

    @property
    def flicker_noise(self) -> float:
        """Density of the 1/f part of the voltage noise times the frequency, V²."""
        return self.voltage_noise**2 * (self.voltage_noise_corner or 0.0)

    @property
    def is_limited(self) -> bool:
        """Whether the part has any limit."""
        limits = (self.slew_rate, self.output_current, -self.saturation)
        return any(math.isfinite(limit) for limit in limits)

    @property
    def first_pole(self) -> float:
        """Dominant pole ``gbw / A0``, Hz; infinite if `gbw` is."""
        return self.gbw / self.dc_gain


def unity_gain_bandwidth(opamp: OpAmp) -> float:
    """Return the frequency in Hz at which ``|A| = 1``; infinite for an op-amp without poles.

    With ``y = (f/f1)^2`` and ``r = (f1/f2)^2``, ``|A|^2 = 1`` is the quadratic
    ``r y^2 + (1 + r) y = A0^2 - 1``; the form of its positive root below has no cancellation.
    """
    if math.isinf(opamp.gbw):
        return math.inf
    r = (opamp.first_pole / opamp.second_pole) ** 2
    excess = opamp.dc_gain**2 - 1.0
    y = 2.0 * excess / (1.0 + r + math.sqrt((1.0 + r) ** 2 + 4.0 * r * excess))
    return opamp.first_pole * math.sqrt(y)


def phase_margin(opamp: OpAmp) -> float:
    """Return 180 minus the phase lag of A at unity gain, degrees; 180 without poles."""
    if math.isinf(opamp.gbw):
        return 180.0
    f_u = unity_gain_bandwidth(opamp)
    lag = math.atan(f_u / opamp.first_pole) + math.atan(f_u / opamp.second_pole)
    return 180.0 - math.degrees(lag)


def _relative_poles(dc_gain: float, margin: float) -> tuple[float, float]:
    """Return ``(f_u/f1, f_u/f2)`` of a two-pole op-amp from its gain and phase margin (degrees).

    From ``(1 + j a)(1 + j b) = A0 exp(j (180 - margin))`` follow the sum ``a + b = A0 sin(margin)``
    and the product ``a b = 1 + A0 cos(margin)``, so a and b are the roots of a quadratic.
    """
    angle = math.radians(margin)
    total, product = dc_gain * math.sin(angle), 1.0 + dc_gain * math.cos(angle)
    discriminant = total * total - 4.0 * product
    if not (0.0 < margin < 180.0 and product >= 0.0 and discriminant >= 0.0):
        most = math.degrees(math.acos(-1.0 / dc_gain))
        least = math.degrees(math.acos(1.0 - 2.0 / dc_gain))
        raise ValueError(
            f"phase_margin = {margin!r}: with two real poles and a gain of {dc_gain!r} it lies "
            f"between {least:.4g} and {most:.4g} degrees"
        )
    a = (total + math.sqrt(discriminant)) / 2.0
    return a, product / a


def poles_from_phase_margin(
    dc_gain: float, unity_gain_bandwidth: float, phase_margin: float
) -> tuple[float, float]:
    """Return ``(gbw, second_pole)`` in Hz from figures of data sheets (V/V, Hz, degrees).

    It raises ValueError where no pair of real poles has this margin.
    """
    a, b = _relative_poles(dc_gain, phase_margin)
    second_pole = unity_gain_bandwidth / b if b > 0.0 else math.inf
    return dc_gain * unity_gain_bandwidth / a, second_pole


def second_pole_from_phase_margin(dc_gain: float, gbw: float, phase_margin: float) -> float:
    """Return the second pole, Hz, of a `phase_margin` (degrees) at a `gbw` (Hz), or raise."""
    if math.isinf(gbw):
        raise ValueError(f"phase_margin = {phase_margin!r}: needs a finite gbw, not {gbw!r}")
    a, b = _relative_poles(dc_gain, phase_margin)
    return gbw / dc_gain * a / b if b > 0.0 else math.inf
