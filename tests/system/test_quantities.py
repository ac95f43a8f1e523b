"""Quantities: every spelling that is taken, every slip that is refused."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.system.quantities import EXAMPLES, UNITS, parse, show

LETTERS = "0123456789.,eE+-_%  µΩkMmpFVHzoh٣²\n\0"


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("10pF", "F", 1e-11),
        ("10p", "F", 1e-11),
        ("1e-11", "F", 1e-11),
        (" 1e-11 F ", "F", 1e-11),
        (".5V", "V", 0.5),
        ("+5.V", "V", 5.0),
        ("-1mV", "V", -1e-3),
        ("1M", "ohm", 1e6),
        ("1m", "ohm", 1e-3),
        ("1f", "F", 1e-15),
        ("1F", "F", 1.0),
        ("1mho", "S", 1.0),
        ("1umho", "S", 1e-6),
        ("1farad", "F", 1.0),
        ("1amp", "A", 1.0),
        ("5msec", "s", 5e-3),
        ("1MHz", "Hz", 1e6),
        (7, "V", 7.0),
        (0.25, "V", 0.25),
    ],
)
def test_spellings(text: str | float, unit: str, value: float) -> None:
    assert parse(text, unit) == value


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("1,5pF", "F", "not as a comma"),
        ("1.2.3k", "ohm", "not a number"),
        ("10 V", "F", "the unit is 'V'"),
        ("10ohm", "S", "the unit is 'ohm'"),
        ("10ppF", "F", "the unit is 'pF'"),
        ("10 p F", "F", "not a number"),
        ("1mhz", "Hz", "the unit is 'hz'"),
        ("1 megahertz", "Hz", "the unit is"),
        ("10%", "V", "not a number"),
        ("1_000", "ohm", "not a number"),
        ("C = 10pF", "F", "not a number"),
        ("1kohm # comment", "ohm", "not a number"),
        ("q", "F", "not a number"),
        ("Z0", "ohm", "not a number"),
        ("pF", "F", "not a number"),
        ("", "F", "not a number"),
        ("0x10", "F", "not a number"),
        ("1e", "F", "the unit is 'e'"),
        ("1e3k", "ohm", "the unit is 'k'"),
        ("nan", "F", "not a number"),
        ("1e400", "F", "not finite"),
        (float("nan"), "F", "not finite"),
        (float("-inf"), "F", "not finite"),
        (10**400, "F", "not finite"),
        (True, "F", "expected a quantity"),
        (None, "F", "expected a quantity"),
        ([1], "F", "expected a quantity"),
    ],
)
def test_slips_are_refused_with_what_is_accepted(text: object, unit: str, says: str) -> None:
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
