"""Quantities: every spelling that is taken, every slip that is refused."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.system.quantities import EXAMPLES, UNITS, parse, show

LETTERS = "0123456789.,eE+-_%  µΩkMmpFVHzoh٣²\n\0"


SPELLINGS = (
    "10pF F 1e-11", "10p F 1e-11", "1e-11 F 1e-11", " 1e-11 F  F 1e-11", ".5V V 0.5", "+5.V V 5",
    "-1mV V -1e-3", "1M ohm 1e6", "1m ohm 1e-3", "1f F 1e-15", "1F F 1", "1mho S 1",
    "1umho S 1e-6", "1farad F 1", "1amp A 1", "5msec s 5e-3", "1MHz Hz 1e6",
)  # fmt: skip


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spellings(spelling: str) -> None:
    text, unit, value = spelling.rsplit(" ", 2)
    assert parse(text, unit) == float(value)
    assert parse(float(value), unit) == float(value)


SLIPS: dict[str, tuple[tuple[object, str], ...]] = {
    "not as a comma": (("1,5pF", "F"),),
    "the unit is 'V'": (("10 V", "F"),),
    "the unit is 'ohm'": (("10ohm", "S"),),
    "the unit is 'pF'": (("10ppF", "F"),),
    "the unit is 'hz'": (("1mhz", "Hz"),),
    "the unit is 'e'": (("1e", "F"),),
    "the unit is 'k'": (("1e3k", "ohm"),),
    "the unit is": (("1 megahertz", "Hz"),),
    "not a number": (
        *((text, "ohm") for text in ("1.2.3k", "1_000", "1kohm # comment", "Z0")),
        *((text, "F") for text in ("10 p F", "C = 10pF", "q", "pF", "", "0x10", "nan", "10%")),
    ),
    "not finite": tuple((n, "F") for n in ("1e400", float("nan"), float("-inf"), 10**400)),
    "expected a quantity": ((True, "F"), (None, "F"), ([1], "F")),
}


@pytest.mark.parametrize("says", SLIPS)
def test_slips_are_refused_with_what_is_accepted(says: str) -> None:
    for text, unit in SLIPS[says]:
        with pytest.raises(ValueError, match=says) as caught:
            parse(text, unit)
        assert EXAMPLES[unit] in str(caught.value)


@given(st.floats(1e-17, 1e13), st.sampled_from(sorted(UNITS)))
def test_what_is_shown_can_be_read(value: float, unit: str) -> None:
    assert parse(show(value, unit, 12), unit) == pytest.approx(value, rel=1e-11)


@given(st.text(LETTERS, max_size=12), st.sampled_from(sorted(UNITS)))
def test_any_text_gives_a_number_or_a_message(text: str, unit: str) -> None:
    with contextlib.suppress(ValueError):
        assert isinstance(parse(text, unit), float)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1e-11, "F", "10 pF"),
        (-3.313e-7, "S", "-331.3 nS"),
        (0.0, "V", "0 V"),
        (-0.0, "Hz", "0 Hz"),
        (float("inf"), "s", "inf s"),
        (1.786e6, "ohm", "1.786 Mohm"),
        (-23100.0, "1/s", "-23.1 k/s"),
        (1.0, "1/s", "1 /s"),
        (0.5735, "1/s", "0.5735 /s"),  # not 573.5 m/s, a speed
        (-4.2e-9, "1/s", "-4.2e-09 /s"),
    ],
)
def test_shown_for_people(value: float, unit: str, text: str) -> None:
    assert show(value, unit) == text
