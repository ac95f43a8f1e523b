"""Physical quantities as a person writes them: the one place where SI prefixes are read.

``M`` is mega and ``m`` is milli, as in SI and unlike SPICE; ``meg`` is understood. A bare number
is in base units. Everything that taction writes is a plain float.
"""

from __future__ import annotations

import math
import re

from quantiphy import QuantiPhyError, Quantity

UNITS: dict[str, tuple[str, ...]] = {
    "F": ("F", "farad", "farads"),
    "ohm": ("ohm", "ohms", "Ohm", "Ohms", "\N{GREEK CAPITAL LETTER OMEGA}", "\N{OHM SIGN}"),
    "S": ("S", "siemens", "mho"),
    "V": ("V", "volt", "volts"),
    "A": ("A", "amp", "amps"),
    "Hz": ("Hz",),  # no "hz": "1mhz", a millihertz, is never what was meant
    "s": ("s", "sec"),
}
# quantiphy alone would also take names of constants, "C = 10pF", "1kohm # a comment" and "1_000".
_QUANTITY = re.compile(
    r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*([^\W\d_]*)\s*"
)
EXAMPLES = {
    "F": "10pF",
    "ohm": "1.8Mohm",
    "S": "0.33uS",
    "V": "1V",
    "A": "1uA",
    "Hz": "1MHz",
    "s": "5ms",
}


def parse(value: object, unit: str) -> float:
    """Return `value` in base units of `unit`.

    Parameters
    ----------
    value : str, int or float
        ``"10pF"``, ``"10 pF"``, ``"10p"``, ``"1e-11"`` or a number.
    unit : str
        A key of `UNITS`.

    Raises
    ------
    ValueError
        With a text that says what would be accepted.
    """
    wanted = f"a quantity in {unit}, such as {EXAMPLES[unit]!r}, or a number in {unit}"
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"expected {wanted}")
    if isinstance(value, str):
        number, found = _read(value, unit, wanted)
        if found and found not in UNITS[unit]:
            raise ValueError(f"the unit is {found!r}; expected {wanted}")
    else:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"not finite; expected {wanted}")
    return number


def _read(text: str, unit: str, wanted: str) -> tuple[float, str]:
    if "," in text:  # quantiphy would read "1,5pF" as 15 pF
        raise ValueError(f"no comma, a decimal point is a '.'; expected {wanted}")
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(f"not a number with a prefix and a unit; expected {wanted}")
    digits, suffix = match.groups()
    if suffix in UNITS[unit]:  # quantiphy would take the m of "1mho" for milli
        return float(digits), suffix
    if suffix.lower().startswith("meg"):
        suffix = "M" + suffix[3:]
    try:
        quantity = Quantity(digits + suffix, ignore_sf=False)
    except QuantiPhyError as error:
        raise ValueError(f"not a number with a prefix and a unit; expected {wanted}") from error
    return float(quantity.real), str(quantity.units)


def show(value: float, unit: str, digits: int = 4) -> str:
    """Return `value` for people, with an SI prefix: ``show(1e-11, "F")`` is ``"10 pF"``."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g} {unit}".rstrip()
    return str(Quantity(value, unit).render(prec=digits - 1, strip_zeros=True))
