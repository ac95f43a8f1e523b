"""S-expressions as KiCad reads them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

Atom: TypeAlias = str | float
Expression: TypeAlias = Sequence[Any]  # of atoms and expressions


class Quoted(str):
    """A text in quotation marks; a plain `str` is a keyword."""

    __slots__ = ()


def written(expression: Expression, indent: int = 0) -> str:
    r"""Return an S-expression as text: each list within a list on a line of its own.

    Examples
    --------
    >>> print(written(["label", Quoted("a \"b\""), ["at", 1.0, -2.54, 0]]))
    (label "a \"b\""
      (at 1 -2.54 0)
    )
    """
    line = "  " * indent + "("
    nested = False
    for place, item in enumerate(expression):
        if isinstance(item, str) or not isinstance(item, Sequence):
            line += (" " if place else "") + _atom(item)
        else:
            nested = True
            line += "\n" + written(item, indent + 1)
    return line + ("\n" + "  " * indent if nested else "") + ")"


def _atom(value: Atom) -> str:
    if isinstance(value, Quoted):
        text = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{text}"'
    # Lengths are multiples of 0.01 mm, so six decimals are exact, and there is no -0.
    return (
        value if isinstance(value, str) else f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".")
    )
