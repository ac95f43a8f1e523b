"""Options that take a number: what is no number, or no finite one, is refused with the range."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest

from taction.cli.command import NumberRange
from taction.cli.main import COMMANDS, command
from taction.cli.running import made
from tests.support.running import taction


def number_options() -> Iterator[tuple[str, str, click.FloatRange]]:
    for name in COMMANDS:
        for option in made(name, command(name)).params:
            if isinstance(option.type, click.FloatRange | click.types.FloatParamType):
                yield name, option.opts[0], option.type


def test_every_option_with_a_number_has_the_one_type() -> None:
    found = list(number_options())
    assert len(found) >= 14
    assert [each for each in found if not isinstance(each[2], NumberRange)] == []


@pytest.mark.parametrize(
    "text", ["nan", "inf", "-inf", "1e999", "1_0", "\N{ARABIC-INDIC DIGIT TWO}"]
)
def test_what_is_no_finite_number_is_in_no_range(text: str) -> None:
    for _, _, kind in number_options():
        with pytest.raises(click.BadParameter, match="is not a valid"):
            kind.convert(text, None, None)


def test_the_message_says_what_is_accepted() -> None:
    found = taction("diff", "a.toml", "b.toml", "--agree", "nan")
    assert found.exit_code == 2
    assert "'nan' is no number." in found.stderr
    assert "Expected a number in 0<x<=1." in found.stderr
