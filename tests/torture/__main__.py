"""``python -m tests.torture``: kill studies at random instants, and say what was wrong."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
from pathlib import Path

from tests.torture.killing import Report
from tests.torture.session import is_fault, session, summary, table


def main() -> int:
    """Run the session; the exit status is 1 if anything was wrong."""
    parser = argparse.ArgumentParser(prog="make torture", description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--disasters", type=int, default=10, help="of each kind")
    parser.add_argument("--commands", type=int, default=200, help="on a bad machine")
    parser.add_argument("--points", type=int, default=12, help="points of a sweep")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="disturbances at a time")
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGHUP):  # a run in the background ignores them
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    folder = Path(tempfile.mkdtemp(prefix="torture-"))
    reports: list[Report] = []
    try:
        for report in session(
            folder,
            kills=options.kills,
            disasters=options.disasters,
            commands=options.commands,
            points=options.points,
            seed=options.seed,
            jobs=options.jobs,
        ):
            reports.append(report)
            print(f"{len(reports)}: {summary(report)}", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("stopped: the report holds what is done", file=sys.stderr)
    print(table(reports))
    faults = [report for report in reports if is_fault(report)]
    for report in faults:
        print(summary(report))
    if faults:
        print(f"{len(faults)} of {len(reports)} went wrong; their folders are in {folder}")
        return 1
    shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
