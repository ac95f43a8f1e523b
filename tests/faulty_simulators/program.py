"""The program of all ways: ``python -m tests.faulty_simulators.program WAY`` and ngspice's words.

It understands the two calls that taction makes: ``-v`` and a deck.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence

from tests.faulty_simulators.ways import RUNS, ends_by, floods, leaves, waits


def answers(text: str) -> Callable[[], None]:
    """Return a way: a text on stdout."""
    return lambda: print(text, flush=True)


usual = answers("** ngspice-46 : Circuit level simulation program\n** Compiled with KLU Direct")

VERSIONS: dict[str, Callable[[], None]] = {
    "version 39": answers("** ngspice-39.3 : Circuit level simulation program"),
    "version 38": answers("** ngspice-38 : Circuit level simulation program"),
    "another program": answers("Spice Opus 3.0"),
    "a version of 5,000 digits": answers("ngspice-" + "9" * 5000),
    "the version floods": floods(1),
    "the version hangs": waits,
    "the version leaves a child": leaves(session=False, first=usual),
    "the version ends by a signal": ends_by(signal.SIGSEGV),
}


def main(name: str, words: Sequence[str]) -> None:
    """Answer one call in the way `name`."""
    if "-v" in words:
        VERSIONS.get(name, usual)()
    else:
        RUNS[name]()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
