"""Physical quantities with SI prefixes; no other module reads prefixes.

``M`` is mega and ``m`` is milli, as in SI and unlike SPICE; ``meg`` is mega, too. A number without
a unit is in base units. taction writes plain floats.
"""

from __future__ import annotations

import math
import re

_SPELT: dict[str, tuple[str, ...]] = {
    "F": ("10pF", "F", "farad", "farads"),
    "ohm": ("1.8Mohm", "ohm", "ohms", "Ohm", "Ohms", "\u03a9", "\u2126"),  # both signs
    "S": ("0.33uS", "S", "siemens", "mho"),
    "V": ("1V", "V", "volt", "volts"),
    "A": ("1uA", "A", "amp", "amps"),
    "Hz": ("1MHz", "Hz"),  # no "hz": "1mhz" would be a millihertz, and users mean MHz
    "s": ("5ms", "s", "sec"),
    "V/s": ("0.5V/us", "V/s"),
    "rtHz": ("1rtHz", "rtHz"),  # also written with the sign of the square root
    "V/rtHz": ("3nV/rtHz", "V/rtHz"),
    "A/rtHz": ("0.4pA/rtHz", "A/rtHz"),
    "K": ("10K", "K"),
    "V/K": ("10uV/K", "V/K"),
    "A/K": ("5nA/K", "A/K"),
}
"""An example of each unit, and the ways to write the unit."""
UNITS = {unit: names for unit, (_, *names) in _SPELT.items()}
EXAMPLES = {unit: example for unit, (example, *_) in _SPELT.items()}
_QUANTITY = re.compile(
    r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*([^\W\d_]*)\s*"
)
OHM = re.compile(r"ohm\b")
MICRO = re.compile(r"(?<=\d )u(?=[A-Za-zΩ/])|(?<=V/)u(?=s\b)")
PREFIXES = dict(zip(range(-18, 15, 3), ("a", "f", "p", "n", "u", "m", "", *"kMGT"), strict=True))
POWERS = {name: power for power, name in PREFIXES.items() if name}
POWERS |= {"K": 3, "µ": -6, "\N{GREEK SMALL LETTER MU}": -6}  # read, too
NONE = "–"  # in the place of a value
LONGEST = 100  # characters of a quantity


def parse(value: object, unit: str) -> float:
    """Return `value` (``"10pF"``, ``"10 pF"``, ``"10p"``, ``"1e-11"``, a number) in `unit`.

    ValueError: `value` is not a finite quantity in `unit`, a key of `UNITS`.
    """
    expected = f"expected a quantity in {unit}, such as {EXAMPLES[unit]!r}, or a number in {unit}"
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(expected)
    try:
        found = _read(value, unit, expected) if isinstance(value, str) else float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise ValueError(f"not finite; {expected}")
    return found


def _read(text: str, unit: str, expected: str) -> float:
    if len(text) > LONGEST:
        raise ValueError(f"over {LONGEST} characters; {expected}")
    if "," in text:
        raise ValueError(f"write the decimal point as '.', not as a comma; {expected}")
    above, slash, below = text.replace("\N{SQUARE ROOT}", "rt").partition("/")
    if slash and "/" in unit:
        upper, lower = unit.split("/")
        try:
            return parse(above, upper) / parse("1" + below.strip(), lower)
        except (ValueError, ZeroDivisionError):
            raise ValueError(f"not a number with prefixes and units; {expected}") from None
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(f"not a number with a prefix and a unit; {expected}")
    digits, suffix = match.groups()
    if suffix and suffix not in UNITS[unit] and "e" not in digits.lower():
        length = 3 if suffix.lower().startswith("meg") else 1
        power = 6 if length == 3 else POWERS.get(suffix[0])
        if power is not None:
            digits, suffix = f"{digits}e{power}", suffix[length:]
    if suffix and suffix not in UNITS[unit]:
        raise ValueError(f"the unit is {suffix!r}; {expected}")
    return number(digits)


def number(text: str) -> float:
    """Return a plain number; NaN and infinity are numbers here.

    ValueError: the text is no number, or one that Python reads and nobody means: with digits of
      another script, with ``_``, or so small that it would be 0.
    """
    if not text.isascii() or "_" in text:
        odd = next(character for character in text if character == "_" or not character.isascii())
        raise ValueError(f"{text.strip()!r} has {odd!r}; expected the digits 0 to 9")
    value = float(text)
    if value == 0.0 and re.search("[1-9]", text.lower().partition("e")[0]):
        raise ValueError(f"{text.strip()!r} would be 0; expected 0, or a number above 1e-300")
    return value


def fraction(given: object) -> float:
    """Return a fraction from a share such as ``"5%"``, or from a number; see `number`.

    >>> fraction("5%"), fraction("0.05"), fraction(0.05)
    (0.05, 0.05, 0.05)
    """
    text = str(given).strip()
    return number(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)


def percent(share: float, digits: int = 3) -> str:
    """Return a fraction as per cent, without a sign for zero: ``percent(0.0123)``: ``1.23 %``."""
    return f"{100.0 * share + 0.0:.{digits}g} %"


def show(value: float, unit: str, digits: int = 4) -> str:
    """Return `value` as text with an SI prefix: ``show(1e-11, "F")`` is ``"10 pF"``.

    A rate has the unit ``1/s``: ``show(-23100.0, "1/s")`` is ``"-23.1 k/s"``, and below 1 /s it has
    no prefix, because ``0.57 /s`` would be ``570 m/s``, a speed.
    """
    unit = "/s" if unit == "1/s" else unit
    if value == 0 or not math.isfinite(value):
        return f"{value + 0.0:g} {unit}".rstrip()  # -0.0 + 0.0 is 0.0
    if unit == "/s" and abs(value) < 1.0:
        return f"{value:.{digits}g} /s"
    if unit == "V/s":  # as data sheets have it
        return f"{1e-6 * value:.{digits}g} V/us"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    above = int(exponent) % 3
    power = int(exponent) - above
    text = f"{float(f'{mantissa}e{above}'):.{max(digits, above + 1)}g}"
    if power not in PREFIXES:
        return f"{text}e{power} {unit}".rstrip()
    return f"{text} {PREFIXES[power]}{unit}" if unit else f"{text}{PREFIXES[power]}"


def written(value: float, unit: str) -> str:
    """Return `value` as a scene file has it: text that reads as exactly this value, else a number.

    >>> written(2400.0, "ohm"), written(1.0 / 3.0, "V")
    ('"2.4kohm"', '0.3333333333333333')
    """
    text = show(value, unit, 7).replace(" ", "")
    exact = unit in UNITS and math.isfinite(value) and value != 0 and parse(text, unit) == value
    return f'"{text}"' if exact else repr(value)


def show_rate(rate: float, digits: int = 4) -> str:
    """Return a growth rate, 1/s, with its sign: ``show_rate(1000.0)`` is ``"+1 k/s"``."""
    return ("+" if rate > 0 else "") + show(rate, "1/s", digits)


def show_pole(pole: complex, digits: int = 4) -> str:
    """Return a pole, 1/s, as its growth rate and its frequency: ``-23.1 k/s at 49 kHz``."""
    rate = show_rate(pole.real, digits)
    if pole.imag == 0:
        return rate
    return f"{rate} at {show(abs(pole.imag) / (2.0 * math.pi), 'Hz', digits)}"


def quantity(value: float | None, unit: str, digits: int = 4) -> str:
    """Return a value with an SI prefix and its unit; a dash for no value.

    >>> quantity(1.9e6, "ohm"), quantity(2.4e-6, "s"), quantity(None, "V")
    ('1.9 MΩ', '2.4 µs', '–')
    """
    if value is None or not math.isfinite(value):
        return NONE
    return readable(show(value, unit, digits))


def readable(text: str) -> str:
    """Return `text` with the signs for ohm and micro."""
    return MICRO.sub("µ", OHM.sub("Ω", text))


TERMS = {"noise": "output noise"}  # strain and op-amps have noise, too (docs/glossary.md)


def spaced(name: str) -> str:
    """Return the name of a figure or a check in words: ``settling_time``: ``settling time``."""
    return TERMS.get(name, name.replace("_", " "))


def banded(name: str, band: float | None) -> str:
    """Return the name of a reading in words, that of a settling time with its band.

    `band` is a fraction of the step amplitude; None where the values have several bands.

    >>> banded("settling_time", 0.01), banded("settling", 0.005), banded("rise_time", 0.01)
    ('settling time to ±1 %', 'settling to ±0.5 %', 'rise time')
    """
    known = name.startswith("settl") and band is not None
    return f"{spaced(name)}{f' to ±{100.0 * (band or 0.0):g} %' if known else ''}"


def counted(number: int, noun: str, nouns: str = "") -> str:
    """Return a number with its noun: ``counted(2, "entry", "entries")`` is ``"2 entries"``."""
    return f"{number} {noun}" if number == 1 else f"{number} {nouns or noun + 's'}"


def sizes(channels: int, sensors: int) -> str:
    """Return the numbers of channels and sensors in words; as many sensors are not named."""
    words = counted(channels, "channel")
    return words if sensors == channels else f"{words}, {counted(sensors, 'sensor')}"
