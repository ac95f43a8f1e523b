"""Arrays in a scene, instead of names of files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic_core import CoreSchema, core_schema

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.system.array_types import Floats

EXPECTED = "expected the name of a file, or an array of real numbers: rows of one length"


def in_memory(values: ArrayLike) -> Any:
    """Return `values` as an array, if possible, for a field `ArrayOrFile`."""
    import numpy as np

    try:
        return np.asarray(values)
    except ValueError:  # rows of different lengths
        return values


def fitted(values: Floats, shape: tuple[int | None, ...]) -> Floats:
    """Return `values` with the dimensions of `shape`, where None stands for any length.

    A vector may be a row or a column.

    Raises
    ------
    ValueError
        Another shape, no entry, or an entry that is not finite.
    """
    import numpy as np

    if len(shape) == 1 and values.ndim == 2 and 1 in values.shape:
        values = values.ravel()
    if len(shape) == 2 and values.ndim == 1:
        values = values[None, :]
    if values.size == 0:
        shown = " x ".join(map(str, values.shape))
        raise ValueError(f"no numbers (shape {shown}); expected {_words(shape)}")
    fits = values.ndim == len(shape) and all(
        expected in (None, length) for expected, length in zip(shape, values.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"shape {' x '.join(map(str, values.shape))}; expected {_words(shape)}")
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        place = ", ".join(str(i + 1) for i in bad[0])
        raise ValueError(f"entry ({place}) is not finite")
    return values


def _words(shape: tuple[int | None, ...]) -> str:
    """Return the expected shape: its lengths, or what it is where these may be any."""
    if all(length is None for length in shape):
        return "rows of numbers" if len(shape) > 1 else "a column of numbers"
    return " x ".join("any" if length is None else str(length) for length in shape)


@dataclass(frozen=True, slots=True)
class _NameOrArray:
    """Annotation of a field: the name of a file, or an array of real numbers."""

    def check(self, value: object) -> Any:
        """Return the name, or a read-only copy of the array."""
        if isinstance(value, str) and value:
            return value
        if isinstance(value, list):  # in a TOML file
            value = _from_lists(value)
        if getattr(getattr(value, "dtype", None), "kind", "") in ("i", "u", "f"):
            import numpy as np

            copy = np.array(value, dtype=np.float64, order="C")
            copy.setflags(write=False)
            return copy
        raise ValueError(EXPECTED)

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(
            lambda value: value if isinstance(value, str) else value.tolist(), when_used="json"
        )
        return core_schema.no_info_plain_validator_function(self.check, serialization=written)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> dict[str, Any]:
        numbers = {"type": "array", "items": {"type": "number"}, "minItems": 1}
        rows = {"type": "array", "items": numbers, "minItems": 1}
        return {"anyOf": [{"type": "string", "minLength": 1}, numbers, rows]}


def _from_lists(values: list[Any]) -> Any:
    """Return numbers, or rows of numbers of one length, as an array; ValueError for others."""
    import numpy as np

    rows = values if all(isinstance(row, list) for row in values) else [values]
    flat = [number for row in rows for number in row]
    numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in flat)
    if not numbers or len({len(row) for row in rows}) != 1:
        raise ValueError(EXPECTED)
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError:
        raise ValueError(f"a number is out of range; {EXPECTED}") from None


ArrayOrFile = Annotated[Any, _NameOrArray()]
