"""The page of the benchmarks: Markdown with plots, and the README's table."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType

from benchmarks.measuring import Figure, Result, Table
from taction.system.atomic_files import write_atomically
from taction.verification.report.renderers.figures import figure_file

BEGIN, END = "<!-- `make bench` writes this table -->\n", "<!-- end of the table -->\n"
COLUMNS = ("what", "over", "median (quartiles)", "pairs", "load", "wanted", "measured")
NOTES = """\
Every row is a ratio to a baseline that ran in turns with it; `pairs` is their number, and `load`
the load average of the machine after them, the measured processes in it. `measured` is the value
that has to keep the limit `wanted`: the median of the ratios, unless the row says mean or largest,
or has a unit. A value that misses its limit is in bold.
"""
WIRES = """\
## Boards with wires

`inv` and `pinv` with wires and their compensation, at an error of 1e-6: processor time of ngspice
with KLU, which runs the deck of the step control that `verify` plans, over that of a transient of
the state-space engine with as many points. [Wires](wires.md) has the times, and
`make bench ARGS=--full` measures the row of N = 32.

| N   | inv                                    | pinv                            |
| --- | -------------------------------------- | ------------------------------- |
| 16  | 399                                    | 327                             |
| 32  | 2,187                                  | 831                             |
| 64  | 7,960                                  | 22,000, extrapolated            |
| 128 | 17,900, extrapolated (curves: 37,900)  | at least 3,800, extrapolated    |

At 64 ngspice ran `inv` to its end (1,595 s) and 460 of the 10,730 planned steps of `pinv` (0.95 s
a step). At 128 ngspice was not run: its times follow from power laws, N^3.7 through 16, 32 and 64
for `inv`, N^3.6 through 16 and 32 for `pinv`, whose step at 64 is slower than this law. The times
of the state-space engine at 128 were measured, 1.16 s and 2.2 s; by its curves they were 0.55 s
and 2.4 s.
"""
ENGINE = """\
## What left the state-space engine, and what stays

Processor time of a warm `verify --engine statespace`. `taction self stress` is right without each
trick that is gone, with no more numbers outside their stated error.

- Modes polished by exact products are gone. Without them paper-breadboard takes 64 ms in place of
  72, eleven-channel 62 in place of 73: they cost more than the modes, and no check read their
  digits.
- The ladder of powers for defective matrices is gone. With blocks of joined modes first
  differences of six channels take 0.6 s in place of 8.
- The second eigenproblem for slow poles is gone: Newton's steps give slow poles as precisely.
- The even and odd halves of mirrored boards stay. Without them paper-breadboard takes 74 ms in
  place of 66, and eleven-channel 89 in place of 63: 29 % of a point of its studies.
- Steps of large linear boards are left to boards that grow. By patterns over the channels a
  verdict of 200 channels takes 2.2 s in place of 5.3, and one of 500 channels 5.9 s in place of
  47. The sensitivities at rest of 200 channels by structured adjoint solves take 0.05 s in place
  of 2.4, and 128 MB in place of 528.
- The grid of a search for peaks and crossings has 32 instants an e-fold, no longer 256. Cubics
  through values and slopes, and what each mode may add by its fourth derivative, take the place
  of chords with the second one, so a third of the instants excludes the same intervals, and a
  search divides 240 intervals of 15 boards in place of 1,531. A warm point of a sweep takes 3.7
  times `eig` in place of 4.6 on paper-breadboard (processor time, in turns with the commit
  before). Chords and envelopes stay where a ringing has several periods between two instants:
  without them `stable-by-1e-4` takes 5.8 s in place of 0.09.
- Crossings of all loci are found at once, with responses in real matrices, and boards of a sweep
  that differ in the knob of the margin alone are confirmed once by the poles beside its edge: a
  warm point over C takes 5.2 times `eig` in place of 7.2 on eleven-channel, and 5.5 in place of
  7.8 on tuned-breadboard (other work on the machine). Edges that such boards shared brought 4.0
  and 3.9, and were taken out: a margin then differed in its twelfth digit with the boards of its
  batch, so that a sweep that went on after a full disk was not the same as one that ran through.
- Loads of op-amps of a batch are found on grids in the same arrays, and the loci of its margins
  are followed together; preferred values are computed once. A warm point of the README's board
  takes 5.5 times `eig` in place of 7.2 (17.3 ms in place of 23.0), tuned-breadboard 4.6 in place
  of 5.3, and eleven-channel 4.3 in place of 4.7 (minima of 7, in turns, at load 3). All digits
  are those of each board alone: exponentials of a board add up mode after mode, whatever boards
  are beside it.
- A search for changes that is not cut takes 2.0 s of processor time (median of 12 boards; before,
  2.1 s): its screening costs more than its verdicts. Its estimates evaluate only modes that can be
  seen, each instant once, and the rise of one channel: of a ringing board 0.8 ms in place of 6, of
  all twelve searches 10 % (three pairs, in turns, at load 10 to 16). A figure below 1 s in an
  earlier table was cut by the 4 s of wall time on a busy machine.
- The designs that a search for changes asks for next are outlined in common arrays, without the
  vectors of a half that rests, and its scans of stable ranges take eigenvalues without bounds: the
  longest of twelve searches takes 0.75 of its processor time, all twelve 0.56 (three pairs, in
  turns, at load 12). Seven of these searches end early, because they now look between a design
  that rises too fast and one that rises too slowly, and find one that passes.
- A command ends without a search for garbage: `verify` of tuned-breadboard takes 0.47 s in place of
  0.62, and a usage error of `onset` 63 ms in place of 75 (medians of 10 pairs, at load 12).
- No collection of garbage falls into a short command: with a threshold of 100,000 one of 28 ms
  fell into the imports of `verify`. The workers' imports have the command's threshold, too.
- Frozen values are made by `frozen` (`taction/system/frozen.py`), which compiles no method at the import.
  Everywhere in place of `dataclass`, `verify` of paper-breadboard by state space takes 0.36 s in
  place of 0.43, a sweep of five points 0.39 in place of 0.49, and a scene file that is missing
  78 ms in place of 88 (minima of 14, in turns, at load 8). All classes share the methods that need
  no compiled text, and 110 of 222 classes compile `__init__`, at their first object.
- The imports of `verify` were 1.8 times those of the baseline, and are 1.1 times with both changes
  or less (medians of 9 and 3 pairs: 1.09, 0.99). Before, 71 ms were the standard library, 38 numpy,
  27 pydantic with what it needs, 11 rich, 7 quantiphy, and 150 our own 210 modules, 90
  of them for the classes. The baseline has 40 ms of scipy and 28 more of numpy. Some 35 modules of
  ours are imported and not called, 5 ms together. Models whose validators are built at their first
  use, and pydantic without its search for plug-ins, save 0 and 5 ms.
- Boards that differ in capacitances alone share the spread of their rests: a warm point of the
  README's sweep takes 17.6 ms in place of 20.6 (minima of 4, in turns, at load 7). Sharing the
  equilibria as well, excluding loads of op-amps by the sum of the modes' sizes before their grids,
  and using what the errors of both solutions of a board have in common were tried: each changed a
  point by less than 5 %, and none of them stays.
- Loads are searched on the grid that excludes most of them, grids begin with one array operation a
  board, and a board's modes are projected on its outputs, or on its loads, once: a warm point of
  the README's sweep takes 14.2 ms in place of 16.5, and one of eleven-channel 32.7 in place of 34.5
  (minima of 5 to 8 pairs, in turns, at load 7).
- Boards of 16 and 32 channels stay with dense matrices. By patterns over the channels a transient
  takes 49 and 66 ms in place of 17 and 65, but a warm `verify` 305 and 405 ms in place of 74 and
  234 (`LARGE` at 100 and at 600; processor time, minima of 5). Its margins then take structured
  solves: 141 factorisations are a third of the 0.97 s of a verdict of 64 channels.
- A sweep computes its points with the capacitances as the fastest axes, whatever their order in the
  command. So points at which op-amps slew are integrated side by side, and points of one call share
  the spread of their rests: the 651 points of the README's sweep take 6.1 s in place of 7.5
  (minima of 2 pairs, batches of 16, processor time). Steps of 5, 7, 11 or 13 stages in place of 9
  make a slewing point 5 times as dear, as dear, 7 % and 15 % dearer.
- Stacks of decompositions, and of the bounds of poles and shares, stay. Without them `check --over`
  of 100 values takes 1.25 times the processor time (sallen-key-fast 8.2 bare runs in place of 10.3,
  wien 30 in place of 40), 15 points of lasso 1.24 times, a warm point of tuned-breadboard 1.1 times
  and one of paper-breadboard 1.06. Without the halves of a mirrored board a warm point takes 1.8
  times as long on paper-breadboard, 1.6 times on eleven-channel and 11 times on tuned-breadboard.
- A number is written by format in place of a library, which takes 5 us in place of 51.
- Newton's method damped on the sum of squares is gone, which a second method had to follow where it
  stalled. The one with the natural monotonicity test finds the equilibria of 110 boards in 757
  steps in place of 4,579, and 0.93 s of processor time in place of 3.3.
- Stay: stacks of stamps and eliminations (a map of poles takes 1.3 to 1.4 times as long without
  either), the poles of boards without their modes (1.6 times), and one equilibrium for boards that
  differ in capacitances alone (1.5 times a point of lasso, 1.3 times a map of paper-exponential).
- Parabolas as first guesses of the crossings of loci, and scans, climbs and brackets that ran side
  by side are gone. Without them and without even and odd loci a warm point of eleven-channel with
  its margin took 5 to 10 % more, one of tuned-breadboard 4 to 11 %, and the poles of an onset or of
  a boundary up to 10 %; each alone brought 0 to 9 %. Even and odd loci are back: without them a
  warm point takes 1.07 times on eleven-channel and 1.04 on tuned-breadboard (of 3 pairs). What
  stays, by what a command takes without it: the values at which the boards of a sweep share their
  confirmations (1.47 times the time of a warm point of tuned-breadboard, 1.24 of eleven-channel), a
  scan that ends at the first unstable board (1.66, `verify --margins` of paper-exponential), poles
  by eigenvalues (1.5 to 2, `onset` and boundaries) in stacks (1.3 to 1.5), the ITP method in place
  of bisection (1.2 to 1.7), and one elimination for all parts of a deck (5.8). The elimination that
  the boards of a batch share for their margins, and responses in real matrices, stay together:
  without both a warm point of tuned-breadboard takes some 9 % more.
- Records are searched without windows, mirrored columns and blocks of levels: the largest value
  from each point on never rises, so that a bisection finds the last point above a level. Every
  digit is the same, and a record of 20,000 points of seven channels costs 6 ms more of 1,300.
- Newton's method begins at the cubic of time over value, no longer at nine bisections of a cubic,
  and caps of resolved intervals come from the cubics of all others, with a slack: a warm point
  takes 0.94 to 0.98 of its time (minima of 15 to 25, in turns). Newton's method itself stays:
  with Ridders's method of records a warm point takes 1.02 to 1.25 of it, and with the bound by
  fourth derivatives in resolved intervals, too, one of paper-breadboard takes 1.17.
"""
SIZE = (11.0, 4.5)  # of a plot, in inches


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


def markdown(table: Table) -> str:
    """Return a table with its title, its columns aligned."""
    lines = [table.columns, *table.rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    ruled = [table.columns, ["-" * width for width in widths], *table.rows]
    padded = ([cell.ljust(w) for cell, w in zip(line, widths, strict=True)] for line in ruled)
    text = "".join(f"| {' | '.join(line)} |\n" for line in padded)
    return f"{table.title}:\n\n{text}" if table.title else text


def figures_table(figures: Iterable[Figure]) -> str:
    """Return the figures as a table."""
    return markdown(Table("", COLUMNS, [cells(figure) for figure in figures]))


def section(name: str, module: ModuleType, result: Result) -> str:
    """Return one section: what it measures, its figures, its plots and its details."""
    text = inspect.getdoc(module) or name
    shows = text.partition("\n")[0].rstrip(".")
    pictures = [f"![{shows}](benchmarks-{plot})\n" for plot in result.plots]
    parts = [f"{text}\n", figures_table(result.figures)]
    return "\n".join([f"## {name}\n", *parts, *pictures, *map(markdown, result.tables)])


def page(title: str, sections: Iterable[str]) -> str:
    """Return the whole page."""
    return "\n".join(["# Benchmarks\n", f"{title}\n", NOTES, *sections, WIRES, ENGINE])


def write_page(root: Path, title: str, sections: Iterable[str]) -> None:
    """Write ``docs/benchmarks.md``."""
    write_atomically(root / "docs" / "benchmarks.md", page(title, sections))


def write_plots(root: Path, results: Mapping[str, Result]) -> None:
    """Draw the plots into ``docs/``."""
    for result in results.values():
        for name, draw in result.plots.items():
            with figure_file(f"{root}/docs/benchmarks-{name}", *SIZE) as figure:
                draw(figure)


def write_table(root: Path, title: str, results: Mapping[str, Result]) -> None:
    """Put each section's first limit, and all that are missed, between the README's markers."""
    readme = root / "README.md"
    before, _, rest = readme.read_text("utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    assert end, f"{readme} has no markers {BEGIN!r} and {END!r}"
    figures = list[Figure]()
    for result in results.values():
        limits = [each for each in result.figures if each.wanted is not None]
        figures += [*limits[:1], *(each for each in limits[1:] if not each.kept)]
    table = figures_table(figures)
    write_atomically(readme, f"{before}{BEGIN}{title}\n\n{table}{END}{after}")
