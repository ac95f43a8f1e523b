"""What is fuzzed, and edits that damage a file: at its bytes, and at the values of a scene."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from taction.system.errors import InputError, SimulationError, TactionError

LONGEST_MESSAGE = 2_010  # characters


@dataclass(frozen=True)
class Target:
    """A reader, its inputs, and what is asked of it.

    `examine` gets an input and an empty folder. It returns the outcome in a few words, lets a
    `TactionError` through, and fails if an accepted input has another meaning than it had to an
    independent reader.
    """

    name: str
    inputs: SearchStrategy[bytes]
    examine: Callable[[bytes, Path], str]

    def outcome(self, content: bytes, folder: Path) -> str:
        """Return the outcome of an input; any exception is a fault."""
        try:
            return self.examine(content, folder)
        except TactionError as error:
            check_message(error)
            return f"refused: {type(error).__name__}"


def check_message(error: TactionError) -> None:
    """Fail if an error does not say what is wrong."""
    text = str(error)
    assert text.strip()
    assert len(text) <= LONGEST_MESSAGE, f"a message of {len(text)} characters"
    assert "Traceback" not in text
    if isinstance(error, InputError):
        assert error.complaints
        assert all(complaint.accepted.strip() for complaint in error.complaints)
    if isinstance(error, SimulationError):
        assert error.exit_status == 3


Edit = Callable[[bytes], bytes]

NASTY = (
    *("0", "-1", "1", "2", "3", "0.5", "-0.0", "1e-30", "1e30", "1e-31", "1e31", "1e-100", "1e100"),
    *("1e308", "1e-308", "1e400", "-1e-5", "inf", "-inf", "nan", "true", "false", "0x10", "1_000"),
    *("9" * 40, "9" * 5000, "1" + "0" * 400, "0." + "0" * 400 + "1"),
    *('""', '" "', '"auto"', '"10pF"', '"10nH"', '"1e400pF"', '"-5"', '"1M"', '"5,3"', '"٣"'),
    *('"inf"', '"nan ohm"', '"\\u0000"', '"\\n.control"', '"../../x"', '"/dev/zero"', '"."', '"/"'),
    *('"T.csv"', '"gcv"', '"discrepancy"', '"exponential"', '"passive"', '"rest"'),
    *('"matrix"', '"tangential"', '"E24"', '"statespace"', '"a b"', f'"{"x" * 5000}"', "'''\n'''"),
    *("[]", "[1]", "[[1]]", "[" * 200 + "]" * 200, "{}", "{ a = 1 }", '{ kind = "csv" }'),
    *("1979-05-27", "07:32:00", "1979-05-27T07:32:00Z"),
)
LINES = (
    *("", "[design]", "[checks]", "[problem]", "[unknown]", "[[design]]", "unknown = 1", "= 1"),
    *('kind = "matrix"', 'matrix = "T.csv"', "channels = 4", "channels = 5000", "sensors = 3"),
    *('lambda = "gcv"', "lambda = 0.1", 'resistance = "1M"', 'amplifier = "exponential"'),
    *('amplifier = "tanh"', 'topology = "passive"', "bias = true", 'resistor_series = "E24"'),
    *(
        "tolerances = { resistors = 0.1 }",
        "design.gain = 1",
        '"design"."gain" = 1',
        "a" + ".a" * 60,
    ),
    *("noise = { variance = 1e-3, seed = 1 }", 'load = { kind = "csv", file = "x.csv" }'),
)
NUMBER = re.compile(rb"(?<![\w.#])\d+(\.\d+)?(e-?\d\d?)?(?![\d.])")
TOKEN = re.compile(rb'"[^"\n]*"|(?<![\w.])[+-]?\d[\w.+-]*|\btrue\b|\bfalse\b')


def _at(share: float, length: int) -> int:
    """Return a place in a text of `length` bytes."""
    return min(int(share * (length + 1)), length)


def edits(change: Callable[..., bytes], *drawn: SearchStrategy[Any]) -> SearchStrategy[Edit]:
    """Return edits by a function of the content and of values that are drawn."""
    return st.tuples(*drawn).map(lambda given: lambda content: change(content, *given))


def splice(content: bytes, share: float, count: int, new: bytes) -> bytes:
    """Put bytes in the place of `count` others."""
    i = _at(share, len(content))
    return content[:i] + new + content[i + count :]


def overwrite(content: bytes, share: float, new: bytes) -> bytes:
    """Put bytes in the place of as many."""
    return splice(content, share, len(new), new)


def move(content: bytes, source: float, target: float, count: int) -> bytes:
    """Copy bytes over others."""
    return overwrite(content, target, content[_at(source, len(content)) :][:count])


def value(content: bytes, share: float, new: str) -> bytes:
    """Replace a number, a text or a truth value."""
    tokens = list(TOKEN.finditer(content))
    if not tokens:
        return content
    token = tokens[_at(share, len(tokens) - 1)]
    return content[: token.start()] + new.encode() + content[token.end() :]


def scale(content: bytes, share: float, exponent: float) -> bytes:
    """Multiply a number, also one with a unit, by a power of ten."""
    numbers = list(NUMBER.finditer(content))
    if not numbers:
        return content
    found = numbers[_at(share, len(numbers) - 1)]
    new = f"{float(found[0]) * 10.0**exponent:.6g}".encode()
    return content[: found.start()] + new + content[found.end() :]


def line(content: bytes, share: float, change: Callable[[bytes], bytes]) -> bytes:
    """Replace a line."""
    lines = content.split(b"\n")
    i = _at(share, len(lines) - 1)
    return b"\n".join([*lines[:i], change(lines[i]), *lines[i + 1 :]])


def _renamed(name: str) -> Callable[[bytes], bytes]:
    return lambda old: name.encode() + b" =" + old.partition(b"=")[2]


# Small numbers are drawn often; their shares are spread over the whole file.
SHARE = st.integers(0, 2**32 - 1).map(lambda n: (n + 7) * 2654435761 % 2**32 / 2**32)
SHORT = st.binary(min_size=1, max_size=9)
IN_PLACE = (
    edits(overwrite, SHARE, st.binary(min_size=1, max_size=1) | SHORT
          | st.integers(1, 500).map(bytes)),
    edits(move, SHARE, SHARE, st.integers(1, 5000)),
)  # fmt: skip
BYTE_EDITS = (
    *IN_PLACE,
    edits(splice, SHARE, st.just(0), SHORT),
    edits(splice, SHARE, st.integers(1, 5000), st.just(b"")),
    edits(splice, SHARE, st.just(sys.maxsize), st.just(b"")),
)
WORDS = st.sampled_from(NASTY) | st.floats().map(repr) | st.integers().map(str)
SCALE_EDIT = edits(scale, SHARE, st.floats(-6.0, 6.0) | st.floats(-0.5, 0.5))
VALUE_EDIT = edits(value, SHARE, WORDS)
LINE_EDIT = edits(
    line,
    SHARE,
    st.one_of(
        st.just(lambda old: b""),
        st.just(lambda old: old + b"\n" + old),
        st.sampled_from(LINES).map(lambda new: lambda old: old + b"\n" + new.encode()),
        st.text(st.sampled_from("abcdehiknlmorstuv_.- "), max_size=12).map(_renamed),
    ),
)


def edited(
    bases: Sequence[bytes], edits: Sequence[SearchStrategy[Edit]], most: int = 3
) -> SearchStrategy[bytes]:
    """Return files after one to `most` edits, or whole ones."""

    def applied(content: bytes, changes: list[Edit]) -> bytes:
        for change in changes:
            content = change(content)
        return content

    changes = st.lists(st.one_of(*edits), max_size=most)
    return st.builds(applied, st.sampled_from(list(bases)), changes)
