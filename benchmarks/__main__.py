"""``make bench``: the page of the benchmarks, in one run.

A quick run takes some minutes on two cores; ``--full`` measures everything. Without ``--only`` the
run writes ``docs/benchmarks.md`` with its plots, and the table of the README.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from importlib import import_module

from threadpoolctl import threadpool_limits

from benchmarks import (
    boards,
    check,
    deck,
    engines,
    grid,
    package,
    page,
    polemap,
    reference,
    startup,
    sweeps,
    verdicts,
)
from benchmarks.measuring import ROOT, Extent, Result, machine
from taction.system.processes import THREADS

SECTIONS = {
    "startup": startup,
    "package": package,
    "grid": grid,
    "boards": boards,
    "verdicts": verdicts,
    "sweeps": sweeps,
    "engines": engines,
    "polemap": polemap,
    "check": check,
    "deck": deck,
    "reference": reference,
}


def main() -> int:
    """Measure, print, and write; return 1 if a section could not be measured."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--full", action="store_true", help="everything; takes about an hour")
    parser.add_argument("--only", choices=SECTIONS, nargs="+", help="some sections; only printed")
    asked = parser.parse_args()
    import_module("taction.system.rare_collections")  # as the command does
    threadpool_limits(1)  # threads that wait for a core that ngspice uses would spin
    os.environ.update(dict.fromkeys(THREADS, "1"))
    extent = Extent.FULL if asked.full else Extent.QUICK
    title = f"`make bench{' ARGS=--full' if asked.full else ''}`: {machine()}."
    results, sections = dict[str, Result](), list[str]()
    print(page.page(title, []), flush=True)
    names = asked.only or list(SECTIONS)
    for name in names:
        try:
            results[name] = SECTIONS[name].measure(extent)
            sections.append(page.section(name, SECTIONS[name], results[name]))
        except Exception as error:
            traceback.print_exc()
            sections.append(f"## {name}\n\nNot measured: {type(error).__name__}.\n")
        print(sections[-1], flush=True)
    if not asked.only:
        page.write_plots(ROOT, results)
        page.write_page(ROOT, title, sections)
        page.write_table(ROOT, title, results)
    return 0 if len(results) == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())
