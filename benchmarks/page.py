"""The page of the benchmarks in Markdown, and the README's table."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType

from benchmarks.measuring import Figure
from taction.system.output_files import write_atomically

BEGIN, END = "<!-- `make bench` writes this table -->\n", "<!-- end of the table -->\n"
COLUMNS = ("what", "over", "median (quartiles)", "pairs", "load", "wanted", "measured")
NOTES = """\
Every row is a ratio to a baseline that ran in turns with it; `pairs` is their number, and `load`
the load average of the machine after them, the measured processes in it. `measured` is the value
that has to keep the limit `wanted`: the median of the ratios, unless the row says mean or largest,
or has a unit. A value that misses its limit is in bold.
"""


def number(value: float) -> str:
    """Write a value with three digits, without an exponent if it is short."""
    return f"{value:.3g}" if value == 0.0 or 1e-3 <= abs(value) < 1e3 else f"{value:.2g}"


def cells(figure: Figure) -> tuple[str, ...]:
    """Return the row of a figure."""
    low, median, high = map(number, figure.quartiles)
    value, wanted = f"{number(figure.measured)} {figure.unit}".strip(), ""
    if figure.wanted is not None:
        limit = "at least" if figure.least else "at most"
        wanted = f"{limit} {number(figure.wanted)} {figure.unit}".strip()
    value = value if figure.kept else f"**{value}**"
    spread, pairs = f"{median} ({low} to {high})", f"{len(figure.ratios)}"
    return figure.what, figure.baseline, spread, pairs, f"{figure.load:.1f}", wanted, value


def table(figures: Iterable[Figure]) -> str:
    """Return the figures as a table, its columns aligned."""
    lines: list[Sequence[str]] = [COLUMNS, *map(cells, figures)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    ruled = [lines[0], ["-" * width for width in widths], *lines[1:]]
    padded = ([cell.ljust(w) for cell, w in zip(line, widths, strict=True)] for line in ruled)
    return "".join(f"| {' | '.join(line)} |\n" for line in padded)


def section(name: str, module: ModuleType, figures: Iterable[Figure]) -> str:
    """Return one section: what it measures, and its figures."""
    return f"## {name}\n\n{inspect.getdoc(module)}\n\n{table(figures)}"


def page(title: str, sections: Iterable[str]) -> str:
    """Return the whole page."""
    return "\n".join(["# Benchmarks\n", f"{title}\n", NOTES, *sections])


def write_page(root: Path, title: str, sections: Iterable[str]) -> None:
    """Write ``docs/benchmarks.md``."""
    write_atomically(root / "docs" / "benchmarks.md", page(title, sections))


def write_table(root: Path, title: str, found: Mapping[str, Sequence[Figure]]) -> None:
    """Put the first figure with a limit of each section between the README's markers."""
    readme = root / "README.md"
    before, _, rest = readme.read_text("utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    assert end, f"{readme} has no markers {BEGIN!r} and {END!r}"
    limits = ([f for f in figures if f.wanted is not None] for figures in found.values())
    shown = [figures[0] for figures in limits if figures]
    write_atomically(readme, f"{before}{BEGIN}{title}\n\n{table(shown)}{END}{after}")
