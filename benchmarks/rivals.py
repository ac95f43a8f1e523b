"""Decks run by others: xargs, and where they are installed spicelib and PySpice.

They only simulate. spicelib's `SimRunner` runs two decks at a time, as its manual says. PySpice
needs the shared library of ngspice, of the same version as the program, and finds it as the
variable NGSPICE_LIBRARY_PATH or the linker says. Its loop is the fastest that is known: plain
arrays, and ``no_mem_check``, without which ngspice reads /proc/meminfo at every time point.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from ctypes.util import find_library
from functools import partial
from importlib import import_module, util
from pathlib import Path
from unittest import mock

from benchmarks.measuring import Cost, children_seconds, python
from taction.verification.engines.ngspice.executable import environment, find_simulator

JOBS = 2
LIBRARY = "NGSPICE_LIBRARY_PATH"
LOOP = "from benchmarks.rivals import {name} as run; run(sys.argv[1])"


def rivals() -> dict[str, Callable[[Path], Cost]]:
    """Return who is installed; each runs every ``*/deck.cir`` of a folder."""
    found: dict[str, Callable[[Path], Cost]] = {"xargs": by_xargs}
    if util.find_spec("spicelib"):
        found["spicelib"] = partial(_in_a_process, "spicelib_loop")
    if os.environ.get(LIBRARY) or find_library("ngspice"):
        found["PySpice"] = partial(_in_a_process, "shared_library_loop")
    return found


def by_xargs(folder: Path) -> Cost:
    """Cost of ``xargs -P 2 ngspice -b`` over the decks."""
    places = sorted(deck.parent for deck in folder.glob("*/deck.cir"))
    run = f'cd "$0" && HOME=$0 SPICE_SCRIPTS=$0 {find_simulator().executable} -b -n -r out.raw'
    words = ["xargs", "-P", f"{JOBS}", "-n", "1", "sh", "-c", f"{run} deck.cir >log 2>&1"]
    text = "".join(f"{place}\n" for place in places)
    before, begun = children_seconds(), time.perf_counter()
    subprocess.run(words, input=text, text=True, check=True, env=environment(folder))
    cost = Cost(time.perf_counter() - begun, children_seconds() - before, 0.0)
    assert all((place / "out.raw").stat().st_size > 1000 for place in places)
    return cost


def _in_a_process(loop: str, folder: Path) -> Cost:
    return python(LOOP.format(name=loop), str(folder))


def spicelib_loop(folder: str) -> None:
    """Run every deck by spicelib."""
    spicelib = import_module("spicelib")
    simulators = import_module("spicelib.simulators.ngspice_simulator")
    ngspice = simulators.NGspiceSimulator.create_from(find_simulator().executable)
    ngspice.set_compatibility_mode(None)
    decks = sorted(Path(folder).glob("*/deck.cir"))
    with mock.patch.dict(os.environ, environment(decks[0].parent)):
        out = {"output_folder": f"{folder}/out", "parallel_sims": JOBS, "simulator": ngspice}
        runner = spicelib.SimRunner(**out)
        for k, deck in enumerate(decks):
            runner.run(str(deck), switches=["-n"], exe_log=True, run_filename=f"{k}.net")
        runner.wait_completion()
    assert runner.okSim == len(decks)


def shared_library_loop(folder: str) -> None:
    """Run every deck by PySpice's shared library, one after the other."""
    decks = sorted(Path(folder).glob("*/deck.cir"))
    os.environ.update(environment(decks[0].parent))
    os.environ.setdefault(LIBRARY, str(find_library("ngspice")))
    library = import_module("PySpice.Spice.NgSpice.Shared").NgSpiceShared.new_instance()
    assert library.ngspice_version == find_simulator().version, "another version of ngspice"
    library.set("no_mem_check")
    for deck in decks:
        library.load_circuit(deck.read_text())
        library.run()
        vectors = library.plot(None, library.last_plot)
        # The public way to an array, `to_waveform`, makes a slower kind of array of it.
        assert vectors["time"]._data.size > 1
        library.destroy()
        library.remove_circuit()
