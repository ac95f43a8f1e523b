"""``make bench``: the page of the benchmarks, in minutes.

Without ``--only`` the run writes ``docs/benchmarks.md`` and the table of the README.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback

from threadpoolctl import threadpool_limits

from benchmarks import boards, check, commands, deck, engines, page, studies
from benchmarks.measuring import ROOT, Figure, machine
from taction.system.processes import THREADS

SECTIONS = {
    "commands": commands,
    "studies": studies,
    "boards": boards,
    "engines": engines,
    "check": check,
    "deck": deck,
}


def main() -> int:
    """Measure, print, and write; return 1 if a section could not be measured."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--only", choices=SECTIONS, nargs="+", help="some sections; only printed")
    asked = parser.parse_args()
    threadpool_limits(1)  # threads that wait for a core that ngspice uses would spin
    os.environ.update(dict.fromkeys(THREADS, "1"))
    title = f"`make bench`: {machine()}."
    found, sections = dict[str, list[Figure]](), list[str]()
    print(page.page(title, []), flush=True)
    names = asked.only or list(SECTIONS)
    for name in names:
        try:
            found[name] = SECTIONS[name].measure(tiny=False)
            sections.append(page.section(name, SECTIONS[name], found[name]))
        except Exception as error:
            traceback.print_exc()
            sections.append(f"## {name}\n\nNot measured: {type(error).__name__}.\n")
        print(sections[-1], flush=True)
    if not asked.only:
        page.write_page(ROOT, title, sections)
        page.write_table(ROOT, title, found)
    return 0 if len(found) == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())
