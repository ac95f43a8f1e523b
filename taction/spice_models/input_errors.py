"""DC errors of an op-amp's inputs: offset voltage, input currents, common-mode rejection.

A data sheet prints a typical and a largest size. Over the op-amps of a type each error is normal:
the largest size is three standard deviations from the mean, and without one the typical size is
0.67 of them, which half of the parts keep. The mean is zero, but that of a bias current with a
known largest size is its typical value, since the currents of one type have one sign.

A board that must work at other temperatures and supply voltages (`Surroundings`) has the changes of
these errors there, too. Each change is one more error with a distribution of its own, taken where
it is largest. The currents of field-effect inputs double every few kelvins: the change has the
spread with which the current as a whole has that of the hot end.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from taction.spice_models.opamp import OpAmp, Spread
from taction.spice_models.presets import opamp_name

NONE = {  # the figures of the input errors, and their values without an error
    "offset_voltage": 0.0,
    "bias_current": 0.0,
    "offset_current": 0.0,
    "common_mode_rejection": math.inf,
}

CHANGES = {
    "offset_drift": "offset_voltage",
    "supply_rejection": "offset_voltage",
    "bias_drift": "bias_current",
    "offset_current_drift": "offset_current",
}  # changes of the input errors with temperature and supply, and the figure that each adds to

ROOM = 25.0  # degrees C: where the figures of a sheet hold
DECIBELS = ("common_mode_rejection", "supply_rejection")
MOST = 3.0  # standard deviations: the largest size of a sheet
TYPICAL = 0.67  # standard deviations: the size that half of the parts keep
Level = Literal["typical", "max", "none"]


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The temperatures and supply voltages at which a board must work."""

    colder: float = 0.0  # the lowest temperature, from `ROOM`, K
    hotter: float = 0.0  # the highest one
    volts: float = 0.0  # largest deviation of both supply voltages, V

    @property
    def kelvin(self) -> float:
        """The end that is farther away from `ROOM`, K, with its sign."""
        return max(self.hotter, self.colder, key=abs)


STEADY = Surroundings()


def spread(
    figure: str, typical: float, most: float | None, unconfirmed: Collection[str] = ()
) -> Spread:
    """Return the distribution of one figure, an input error or a change by one kelvin or volt.

    `typical`: as in the data file; dB of a common-mode rejection.
    `most`: the largest size that the sheet guarantees, of a rejection the least.
    `unconfirmed`: figures and limits, as in `OpAmp.assumed`.

    >>> spread("offset_voltage", 1e-3, 6e-3)
    Spread(mean=0.0, sigma=0.002, assumed=False)
    >>> spread("bias_current", 80e-9, 500e-9).mean
    8e-08
    """
    if figure in DECIBELS:
        typical = 10.0 ** (-typical / 20.0)
        most = None if most is None else 10.0 ** (-most / 20.0)
    if most is None:
        return Spread(0.0, abs(typical) / TYPICAL, assumed=True)
    assumed = f"guaranteed.{figure}" in unconfirmed
    if figure == "bias_current":
        sigma = abs(abs(most) - abs(typical)) / MOST
        return Spread(typical, sigma, assumed or figure in unconfirmed)
    return Spread(0.0, abs(most) / MOST, assumed)


def spreads(opamp: OpAmp) -> dict[str, Spread]:
    """Return the distributions of the input errors that an op-amp has, by figure."""
    most = dict(opamp.guaranteed)
    return {
        name: spread(name, getattr(opamp, name), most.get(name), opamp.assumed)
        for name, none in NONE.items()
        if getattr(opamp, name) != none
    }


def with_input_errors(
    opamp: OpAmp, level: Level, given: Mapping[str, float], around: Surroundings = STEADY
) -> OpAmp:
    """Return the op-amp with its input errors at a `level`.

    `level`: ``"typical"`` and ``"max"``: the sizes of its sheet; ``"none"``: none.
    `given`: figures that a scene gives. Errors replace those of the sheet at every level, and they
      do not vary; changes replace the typical size, without a largest one.
    `around`: where the errors may change.

    Its `varying` are the distributions of the errors that are not given and of all changes, its
    `not_known` the figures that the sheet lacks.
    """
    found = {} if level == "none" else spreads(opamp)
    kept = {name: each for name, each in found.items() if name not in given}
    values: dict[str, Any] = dict(NONE)
    for name, each in kept.items():
        values[name] = getattr(opamp, name)
        if level == "max":  # three standard deviations away
            size = abs(each.mean) + MOST * each.sigma
            signed = math.copysign(size, each.mean or 1.0)
            values[name] = -20.0 * math.log10(size) if name in DECIBELS else signed
    values |= {name: value for name, value in given.items() if name in NONE}
    changed, lacking = changes(opamp, kept, level, given, around)
    known = {*found, *given, *opamp.assumed}  # an assumed zero is no missing figure
    missing = () if level == "none" else tuple(name for name in NONE if name not in known)
    return replace(
        opamp,
        input_errors=values != NONE,
        varying=(*kept.items(), *changed.items()),
        not_known=(*missing, *lacking),
        **values,
    )


def changes(
    opamp: OpAmp,
    errors: Mapping[str, Spread],
    level: Level,
    given: Mapping[str, float],
    around: Surroundings,
) -> tuple[dict[str, Spread], list[str]]:
    """Return the distributions of the changes, and the figures that the sheet lacks.

    `errors` are the distributions of the input errors at `ROOM`; the others as `with_input_errors`.
    """
    most, found, lacking = dict(opamp.guaranteed), dict[str, Spread](), list[str]()
    doubles = math.isfinite(opamp.bias_doubling)
    factors = {"offset_drift": around.kelvin, "supply_rejection": around.volts}
    factors |= {} if doubles else {"bias_drift": around.kelvin}
    for figure, factor in factors.items():
        none = math.inf if figure in DECIBELS else 0.0
        typical, own = given.get(figure, getattr(opamp, figure)), figure in given
        if not factor or (level == "none" and not own):
            continue
        if typical == none and not own:
            lacking.append(figure)
            continue
        each = spread(figure, typical, None if own else most.get(figure), opamp.assumed)
        found[figure] = Spread(0.0, each.sigma * abs(factor), each.assumed)
    if doubles and around.hotter > 0.0:
        factor = 2.0 ** (around.hotter / opamp.bias_doubling)
        for change in ("bias_drift", "offset_current_drift"):
            figure = CHANGES[change]
            each = errors.get(figure, Spread(given.get(figure, 0.0), 0.0))
            wider = each.sigma * math.sqrt(factor**2 - 1.0)
            found[change] = Spread(each.mean * (factor - 1.0), wider, True)
    return {name: each for name, each in found.items() if each.mean or each.sigma}, lacking


def drawn(opamp: OpAmp, deviations: Mapping[str, float], name: str = "") -> OpAmp:
    """Return one op-amp of the type, its errors `deviations` standard deviations from the mean.

    An error without a deviation has its mean. The op-amp that is returned does not vary any more;
    it has the `name`, by default that of the type.
    """
    values: dict[str, Any] = {}
    for error, each in opamp.varying:
        figure = CHANGES.get(error, error)
        before = values.get(figure, getattr(opamp, figure)) if error in CHANGES else 0.0
        values[figure] = before + each.mean + each.sigma * deviations.get(error, 0.0)
    gain = values.pop("common_mode_rejection", None)
    if gain is not None:
        values["rejection_sign"] = math.copysign(1.0, gain)
        values["common_mode_rejection"] = -20.0 * math.log10(abs(gain)) if gain else math.inf
    values["input_errors"] = opamp.input_errors or bool(values)
    return replace(opamp, name=name or opamp.name, varying=(), **values)


def not_known(models: Collection[OpAmp]) -> tuple[str, ...]:
    """Return a sentence for each op-amp whose sheet lacks figures of its input errors."""
    found = list[str]()
    for model in {each.name: each for each in models}.values():
        listed = ", ".join(figure.replace("_", " ") for figure in model.not_known)
        if listed:
            found.append(f"op-amp {opamp_name(model.name)}: {listed} not known, so left out")
    return tuple(found)
