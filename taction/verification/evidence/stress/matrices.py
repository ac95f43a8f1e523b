"""Matrices and strains of the stress cases, made by name.

Every number comes from Python's own generator and plain arithmetic and is rounded to 12 digits, so
a case has the same numbers on every processor.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Rows = list[list[float]]


def make_array(spec: Any) -> Any:
    """Return the rows or values of a table ``make``; lists and names of files are left unchanged.

    Examples
    --------
    >>> make_array({"make": "identity", "rows": 2, "columns": 3})
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    if not isinstance(spec, Mapping):
        return spec
    arguments = dict(spec)
    return GENERATORS[arguments.pop("make")](**arguments)


def _rounded(value: float) -> float:
    return float(f"{value:.12g}")


def identity(rows: int, columns: int | None = None, scale: float = 1.0) -> Rows:
    """Return `scale` on the diagonal and zeros elsewhere."""
    return [[scale * (i == j) for j in range(columns or rows)] for i in range(rows)]


def diagonal(values: Sequence[float]) -> Rows:
    """Return `values` on the diagonal."""
    return [[v * (i == j) for j in range(len(values))] for i, v in enumerate(values)]


def uniform(rows: int, columns: int, seed: int, low: float = -1.0, high: float = 1.0) -> Rows:
    """Return independent entries between `low` and `high`."""
    draw = random.Random(seed).uniform  # noqa: S311
    return [[_rounded(draw(low, high)) for _ in range(columns)] for _ in range(rows)]


def sparse(rows: int, columns: int, seed: int, share: float) -> Rows:
    """Return entries of which a `share` is not zero, at least one per row and per column."""
    draw = random.Random(seed)  # noqa: S311
    dense = uniform(rows, columns, seed + 1)
    kept = [[draw.random() < share for _ in range(columns)] for _ in range(rows)]
    for i in range(max(rows, columns)):
        kept[i % rows][i % columns] = True
    return [[x * k for x, k in zip(*pair, strict=True)] for pair in zip(dense, kept, strict=True)]


def blocks(size: int, block: int, seed: int) -> Rows:
    """Return independent blocks on the diagonal, which do not touch each other."""
    found = [[0.0] * size for _ in range(size)]
    for k in range(0, size, block):
        for i, row in enumerate(uniform(block, block, seed + k)):
            found[k + i][k : k + block] = row
    return found


def graded(rows: int, columns: int, seed: int, decades: float) -> Rows:
    """Return entries of both signs whose sizes are spread over `decades` below 1."""
    draw = random.Random(seed)  # noqa: S311
    exponents = [[-decades * draw.random() for _ in range(columns)] for _ in range(rows)]
    return [[_rounded(draw.choice((-1.0, 1.0)) * 10.0**e) for e in row] for row in exponents]


def outer(column: Sequence[float], row: Sequence[float]) -> Rows:
    """Return the matrix of rank one ``column row^T``."""
    return [[_rounded(a * b) for b in row] for a in column]


def hilbert(rows: int, columns: int) -> Rows:
    """Return ``1 / (i + j + 1)``."""
    return [[1.0 / (i + j + 1) for j in range(columns)] for i in range(rows)]


def skew(size: int, seed: int) -> Rows:
    """Return a skew matrix, singular where `size` is odd."""
    upper = uniform(size, size, seed)
    return [
        [upper[i][j] * (i < j) - upper[j][i] * (i > j) for j in range(size)] for i in range(size)
    ]


def singular(values: Sequence[float], seed: int) -> Rows:
    """Return a square matrix with these singular values, between two reflections."""
    size = len(values)
    draw = random.Random(seed)  # noqa: S311
    u, v = ([draw.uniform(-1.0, 1.0) for _ in range(size)] for _ in range(2))
    left, right = _reflection(u), _reflection(v)

    def entry(i: int, j: int) -> float:
        return _rounded(sum(left[i][k] * values[k] * right[k][j] for k in range(size)))

    return [[entry(i, j) for j in range(size)] for i in range(size)]


def _reflection(x: Sequence[float]) -> Rows:
    square = sum(value * value for value in x)
    return [[(i == j) - 2.0 * a * b / square for j, b in enumerate(x)] for i, a in enumerate(x)]


def spike(size: int, place: int, value: float) -> list[float]:
    """Return zeros with one `value`, at `place` from 1."""
    return [value * (i + 1 == place) for i in range(size)]


def drawn(size: int, seed: int, scale: float = 1.0) -> list[float]:
    """Return independent values between plus and minus `scale`."""
    return uniform(1, size, seed, -scale, scale)[0]


GENERATORS: dict[str, Callable[..., Rows | list[float]]] = {
    function.__name__: function
    for function in (
        identity, diagonal, uniform, sparse, blocks, graded, outer, hilbert, skew, singular,
        spike, drawn,
    )
}  # fmt: skip
