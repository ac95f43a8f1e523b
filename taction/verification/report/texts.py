"""Values as texts, as an engineer writes them, and as the cells of tables."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from taction.system.charts import Outcome
from taction.system.documents import parts_of
from taction.system.quantities import NONE, UNITS, banded, readable, show, spaced

LEAST_SHARE = 1e-6  # of the step: smaller parts have no number
LEAST_AMOUNT = 1e-15  # of any other unit: smaller errors of 0 are rounding
LEAST_ERROR = 1e-6  # of a value: smaller errors have no number
KNOWN = "A value without ± is known to 1 ppm, of itself or of the step, or better."


def figure(value: object, unit: str | None, digits: int = 4) -> str:
    """Return a value with its unit: a dash for none, "never" for infinity, shares as per cent.

    >>> figure(0.0123, "step"), figure(float("inf"), "s"), figure(-1123.46, "1/s")
    ('1.23 %', 'never', '-1.123 k/s')
    >>> figure(19.53, "step"), figure(3e-9, "step"), figure("settled", "")
    ('1950 %', 'under 1 ppm', 'settled')
    """
    if isinstance(value, int) and unit:
        value = float(value)
    if not isinstance(value, float):
        return NONE if value is None else str(value)
    if math.isnan(value):
        return NONE
    if math.isinf(value):
        return "never"
    if unit == "step":
        if 0.0 < abs(value) < LEAST_SHARE:
            return "under 1 ppm"
        rounded = float(f"{100.0 * value:.{min(digits, 3)}g}")  # written without an exponent
        return f"{Decimal(repr(rounded)):f}".removesuffix(".0") + " %"
    if unit in (*UNITS, "1/s"):
        return readable(show(value, unit, digits))
    return f"{value:.{digits}g}"


def with_error(value: float | None, error: float | None, unit: str) -> str:
    """Return a value with the bound on its error in two digits.

    A bound below 1 ppm of the value or of the step is not written: `KNOWN` says so beside a table.

    >>> with_error(0.1, 0.01, "step"), with_error(1.4e-4, 2.1e-17, "s"), with_error(2.0, None, "V")
    ('10 % ± 1 %', '140 µs', '2 V ± unknown')
    >>> with_error(0.0, 3.4e-19, "s"), with_error(0.0, 1e-9, "step"), with_error(1e-9, 1e-15, "V")
    ('0 s', '0 %', '1 nV')
    """
    text = figure(value, unit)
    if value is None or not math.isfinite(value) or is_small(error, value, unit):
        return text
    known = error is not None and math.isfinite(error)
    return f"{text} ± {figure(error, unit, 2) if known else 'unknown'}"


def is_small(error: float | None, value: float, unit: str, whole: float = 0.0) -> bool:
    """Whether the bound on the error of a value, or of the `whole` step, is too small for a number.

    >>> is_small(1.2e-18, 1e-6, "s"), is_small(1.2e-15, 0.0, "V"), is_small(1.2e-15, 0.0, "V", 0.8)
    (True, False, True)
    """
    rounding = LEAST_SHARE if unit == "step" else 0.0 if value else LEAST_AMOUNT
    return error is not None and error <= max(LEAST_ERROR * max(abs(value), whole), rounding)


def titled(name: str, band: float | None = None) -> str:
    """Return the name of a quantity as a title, as `banded` does."""
    text = banded(name, band)
    return f"{text[:1].upper()}{text[1:]}"


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table: its text, the number it sorts by (None: its text), and an outcome."""

    text: str
    number: float | None = None
    outcome: Outcome = ""


Shown = Cell | str | int | None
"""What a table shows as a cell: a text, a number of things, a dash for None."""
Column = str | Callable[[Any], Any]
"""What a column shows of a record: a function, or ``"field unit digits"``, see `shown_by`."""


def cell(value: Shown) -> Cell:
    """Return the cell that shows `value`."""
    if isinstance(value, Cell):
        return value
    return Cell("–" if value is None else str(value), value if isinstance(value, int) else None)


def number_cell(value: float | None, unit: str | None, digits: int = 4) -> Cell:
    """Return a cell that shows a value as `figure` and sorts by it."""
    known = value is not None and math.isfinite(value)
    return Cell(figure(value, unit, digits), value if known else None)


def marked_cell(text: str, outcome: Outcome | None = None) -> Cell:
    """Return a cell with the mark of an outcome, which is its text unless given."""
    return Cell(text, None, text if outcome is None else outcome)


def fields(text: str) -> dict[str, Callable[[Any], Shown]]:
    """Return columns that show fields: ``"title = field unit digits; field; ..."``.

    Without a title a column has the name of its field.
    """
    parts = (each.rpartition(" = ") for each in text.split("; "))
    return {title or spaced(path.partition(" ")[0]): shown_by(path) for title, _, path in parts}


def shown_by(column: Column) -> Callable[[Any], Shown]:
    """Return the function that shows a record in a column.

    A field may be a field of a field: ``origin.name``; of a mapping it is an entry. Without a unit
    it has that of its annotation, which its document has, too; ``@name`` is the field with its
    unit, ``outcome`` marks the text, and ``words`` writes a text for readers.

    >>> shown_by("part")({"part": "C1"}), shown_by("value V 2")({"value": 0.0123})
    ('C1', Cell(text='12 mV', number=0.0123, outcome=''))
    """
    if callable(column):
        return column
    path, *words = column.split()
    digits = int(words.pop()) if words and words[-1].isdigit() else 4
    *owners, name = path.split(".")

    def shown(record: Any) -> Shown:
        for owner in owners:
            record = _part(record, owner)
        value = _part(record, name)
        if isinstance(value, enum.Enum):
            value = str(value.value)
        if words == ["outcome"]:
            return marked_cell(value)
        if not isinstance(value, float):
            return readable(spaced(value)) if words == ["words"] and value else value
        kind: Any = type(record)
        own = (part.unit for part in (() if words else parts_of(kind)) if part.attribute == name)
        unit = next(iter((*words, *own, "")))
        return number_cell(value, _part(record, unit[1:]) if unit.startswith("@") else unit, digits)

    return shown


def _part(record: Any, name: str) -> Any:
    return record[name] if isinstance(record, Mapping) else getattr(record, name)


def rounded_up(value: float, digits: int = 1) -> float:
    """Return the least number of so many digits that is not below a positive value.

    >>> rounded_up(1.2e-15), rounded_up(0.07), rounded_up(0.01234, 2)
    (2e-15, 0.07, 0.013)
    """
    exponent = math.floor(math.log10(value)) + 1 - digits
    return float(f"{math.ceil(value / 10.0**exponent * (1.0 - 1e-12))}e{exponent}")
