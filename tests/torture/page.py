"""The page of the documentation about torture."""

from __future__ import annotations

import argparse
import platform

from taction.verification.studies.running.versions import describe_machine
from tests.torture.killing import LIMIT, ORPHAN_LIMIT, Report
from tests.torture.session import is_fault, summary, table

PAGE = """# Torture: kills at random instants

`make torture ARGS="--page docs/torture.md"` writes this page. A seeded program starts `verify`, `sweep`, `montecarlo` and
`regress` with ngspice, sends signals to their processes at random instants, gives the same command again without a
disturbance, and compares: the document of `--json`, and every row of the database, must be equal to those of a run that
nobody disturbed, except for times.

{number} disturbances with seed {seed}, {points} points in each study: {faults} went wrong. {machine}; {minutes:.0f} min.

{table}
| column | meaning |
|---|---|
| victim | `parent`: the command; `worker`: a process that computes points; `ngspice`; `tree`: all of them at once; `command`: none, the machine is bad |
| hit | how often the victim was there: a command may have ended before |
| ends | exit status of the disturbed command and how often; negative: the number of the signal that ended it |
| equal | after the same command was given again: results equal to those of an undisturbed run, row by row |
| orphans | processes of the run that were left after {orphans:g} s |
| left | temporary folders that the disturbed run left |
| cleared | how many of them the next run removed |
| faults | tracebacks, and commands that had not ended after {limit:g} s |

Ctrl-C (SIGINT) comes after the start of Python, which itself answers a signal with a traceback before the first line of
taction runs. Of a power cut: database and log are copied at one instant of the run, the log is cut at a random byte or has
sectors of zeros, and the command is given again on the copy. A full disk: no file may have more than a random number of
bytes (`ulimit -f`). A full memory disk: `/dev/shm`, where temporary files are, too, has 4 to 300 kB. `removed`: the executable of
ngspice is removed at a random instant. `another version`: the only worker of a Dask cluster has another version of
taction, in some runs without a module that the study needs; its message must have both versions. After these, no point without a verdict
may be stored, since the next run would take it as computed. A command on a bad machine: its messages, its result, its files,
its temporary folder or its programs have no place, or its scene is damaged. It must end with the status that it has elsewhere,
with 3, or, for a reader that has gone, with 141; 1 is left to checks that fail.
A killed command leaves its database, which is complete up to the last stored point, and, after SIGKILL, a folder
`taction-run-*`, which the next run removes. The test `tests/torture/test_torture.py` does the same with few kills.
{list}"""


def page(reports: list[Report], options: argparse.Namespace, seconds: float) -> str:
    """Return the page as Markdown."""
    faults = [report for report in reports if is_fault(report)]
    machine = describe_machine()
    return PAGE.format(
        number=len(reports),
        seed=options.seed,
        points=options.points,
        faults=len(faults) or "none",
        machine=f"Python {platform.python_version()}, ngspice {machine['ngspice']}",
        minutes=seconds / 60,
        table=table(reports),
        orphans=ORPHAN_LIMIT,
        limit=LIMIT,
        list="".join(f"\n- {summary(report)}" for report in faults),
    )
