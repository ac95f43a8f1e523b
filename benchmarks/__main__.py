"""``make bench``: the page of the benchmarks, in one run.

A quick run takes some minutes on two cores; ``--full`` measures everything. Without ``--only`` the
run writes ``docs/benchmarks.md`` with its plots, and the table of the README.
"""

from __future__ import annotations

import argparse

from rich.console import Console
from rich.markdown import Markdown

from benchmarks import boards, command, deck, engines, grid, page, polemap, reference, sweeps
from benchmarks.measuring import ROOT, Extent, Result, machine

SECTIONS = {
    "command": command,
    "grid": grid,
    "boards": boards,
    "sweeps": sweeps,
    "engines": engines,
    "polemap": polemap,
    "deck": deck,
    "reference": reference,
}


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--full", action="store_true", help="everything; takes about an hour")
    parser.add_argument("--only", choices=SECTIONS, nargs="+", help="some sections; only printed")
    asked = parser.parse_args()
    extent = Extent.FULL if asked.full else Extent.QUICK
    title = f"`make bench{' ARGS=--full' if asked.full else ''}`: {machine()}."
    console, results, sections = Console(), dict[str, Result](), list[str]()
    console.print(Markdown(page.page(title, [])))
    for name in asked.only or SECTIONS:
        results[name] = SECTIONS[name].measure(extent)
        sections.append(page.section(name, SECTIONS[name], results[name]))
        console.print(Markdown(sections[-1]))
    if not asked.only:
        page.write_plots(ROOT, results)
        page.write_page(ROOT, title, sections)
        page.write_table(ROOT, title, results)


if __name__ == "__main__":
    main()
