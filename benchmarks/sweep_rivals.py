"""The same decks through other people's runners: spicelib's SimRunner, PySpice's shared library.

What a rival leaves behind is one of two things, and both are timed. ``bare``: it simulates and has
its raw files or arrays. ``measured``: it also stores the same result as a sweep, a row a point in
SQLite of what `verification.measures.measure.measure` finds against the reference answer of the
point. With two decks a point it stores a row a deck.

spicelib runs twice over: as its manual has it, and without its waits. `SimRunner.run` looks for a
free place every 0.1 s and sleeps 10 ms after each start, `wait_completion` looks once a second, and
nothing sets these: two runs take 0.12 s whatever they simulate below that, and 30 take 2.8 s. Our
own semaphore in place of the first and `Thread.join` in place of the last leave the 10 ms. ngspice
starts as quickly as for everybody else: no code models, no compatibility mode.

PySpice needs ngspice's shared library (Debian: libngspice0) of the same version as the program. It
is looked for as PySpice does, by the variable NGSPICE_LIBRARY_PATH, and then as the linker does.
The fastest loop known is run: plain arrays instead of PySpice's analysis objects, and ngspice's
`no_mem_check`, without which it reads /proc/meminfo at every time point (a third of the time).
"""

from __future__ import annotations

import importlib
import logging
import multiprocessing
import os
import subprocess
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, nullcontext
from ctypes.util import find_library
from importlib import util
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from sweep_decks import JOBS, OUTPUTS, Cost, Stopwatch, decks
from sweep_notebook import Notebook

from netlist_gen.overrides.axes import points as points_of
from netlist_gen.overrides.axes import with_values
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.engines.ngspice.executable import environment, find_simulator
from verification.engines.ngspice.raw_file import read_raw
from verification.studies.sweep.plan import Plan

LIBRARY = "NGSPICE_LIBRARY_PATH"
_HOW: dict[str, Any] = {"switches": ["-n"], "exe_log": True}  # no start-up files; a log, no console
Finished = Callable[[Path, Path], None]


def _scenes(plan: Plan) -> list[Scene]:
    """Return the scene of every deck."""
    return [with_values(plan.scene, values) for values in points_of(plan.groups)]


def why_no_spicelib() -> str:
    """Say why spicelib cannot be compared; empty if it can."""
    return "" if util.find_spec("spicelib") else "spicelib is not installed"


def by_spicelib(plan: Plan, folder: Path, *, measured: bool, waits: bool) -> Cost:
    """Cost of spicelib's SimRunner with two parallel runs over the decks; see above for `waits`."""
    spicelib = importlib.import_module("spicelib")
    simulators = importlib.import_module("spicelib.simulators.ngspice_simulator")
    logging.getLogger("spicelib").setLevel(logging.ERROR)
    ngspice = simulators.NGspiceSimulator.create_from(find_simulator().executable)
    ngspice.set_compatibility_mode(None)
    places, scenes = decks(plan, folder), _scenes(plan)
    out = {"output_folder": str(folder / "out"), "parallel_sims": JOBS, "simulator": ngspice}
    with mock.patch.dict(os.environ, environment(places[0])):
        watch = Stopwatch()
        runner = spicelib.SimRunner(**out)
        with closing(Notebook(folder / "a.sqlite", scenes)) if measured else nullcontext() as book:

            def finished(raw: Path, log: Path) -> None:
                """Keep what a run has left, in the run's own thread."""
                if book is not None:
                    vectors = spicelib.RawRead(str(raw))
                    u = [vectors.get_trace(f"v({name})").get_wave() for name in OUTPUTS]
                    time = vectors.get_trace("time").get_wave()
                    book.keep(int(raw.stem), time, np.stack(u, axis=1))

            (_documented if waits else _without_waits)(runner, places, finished)
        cost = watch.stop()
    assert runner.okSim == len(places)
    return cost


def _documented(runner: Any, places: list[Path], finished: Finished) -> None:
    for k, place in enumerate(places):
        how = _HOW | {"run_filename": f"{k}.net", "callback": finished}
        runner.run(str(place / "deck.cir"), **how)
    runner.wait_completion()


def _without_waits(runner: Any, places: list[Path], finished: Finished) -> None:
    free = threading.Semaphore(JOBS)

    def released(raw: Path, log: Path) -> None:
        """Give the place free when all is done with a run."""
        try:
            finished(raw, log)
        finally:
            free.release()

    tasks = []
    for k, place in enumerate(places):
        free.acquire()
        how = _HOW | {"run_filename": f"{k}.net", "callback": released, "callback_on_error": True}
        tasks.append(runner.run(str(place / "deck.cir"), wait_resource=False, **how))
    for task in tasks:
        task.join()
    runner.wait_completion()


class SharedLibrary:
    """PySpice's loop over ngspice's shared library, in a process and on a core of its own."""

    def __init__(self) -> None:
        spawned = multiprocessing.get_context("spawn")
        self._process = ProcessPoolExecutor(1, mp_context=spawned)

    def why_not(self, folder: Path) -> str:
        """Say why PySpice cannot be compared; empty if it can, and it is ready then."""
        (folder / "spinit").write_text("* none\n")
        return self._process.submit(_open, folder, find_simulator().version).result()

    def run(self, plan: Plan, folder: Path, *, measured: bool) -> Cost:
        """Cost of the loop over the decks; the first one's waveforms are compared with ngspice."""
        places, scenes = decks(plan, folder), _scenes(plan)
        database = folder / "a.sqlite" if measured else None
        return self._process.submit(_loop, places, scenes, database).result()

    def close(self) -> None:
        """End the process."""
        self._process.shutdown()


def _open(folder: Path, version: int) -> str:
    """Load the library in this process, with start-up files from `folder`; say why not."""
    os.environ.update(environment(folder))
    os.environ.setdefault(LIBRARY, find_library("ngspice") or "libngspice.so")
    logging.getLogger("PySpice").setLevel(logging.ERROR)  # "unsupported version": it works
    try:
        from PySpice.Spice.NgSpice.Shared import NgSpiceShared

        library = NgSpiceShared.new_instance()
    except ImportError:
        return "PySpice is not installed"
    except OSError as error:
        return f"PySpice finds no libngspice, set {LIBRARY} to it ({str(error).split('.  ')[0]})"
    if library.ngspice_version != version:
        return f"libngspice is of version {library.ngspice_version}, ngspice of version {version}"
    library.set("no_mem_check")
    return ""


def _loop(places: list[Path], scenes: list[Scene], database: Path | None) -> Cost:
    """Run every deck in this process, and measure and store it where there is a `database`."""
    from PySpice.Spice.NgSpice.Shared import NgSpiceShared

    library = NgSpiceShared.new_instance()
    arrays = []
    watch = Stopwatch()
    with closing(Notebook(database, scenes)) if database else nullcontext() as book:
        for k, place in enumerate(places):
            library.load_circuit((place / "deck.cir").read_text())
            library.run()
            vectors = library.plot(None, library.last_plot)
            # The public way to an array, `to_waveform`, makes a slower kind of array of it.
            found = [vectors[name]._data for name in ("time", *OUTPUTS)]
            library.destroy()
            library.remove_circuit()
            if book is not None:
                book.keep(k, found[0], np.stack(found[1:], axis=1))
            arrays.append(found)
    cost = watch.stop()
    _check(places[0], np.stack(arrays[0], axis=1))
    return cost


def _check(place: Path, found: Floats) -> None:
    """Raise AssertionError unless ngspice's program finds the same of a deck, to the last bit."""
    words = [find_simulator().executable, "-b", "-n", "-r", "out.raw", "deck.cir"]
    subprocess.run(words, cwd=place, env=environment(place), capture_output=True, check=True)
    assert np.array_equal(read_raw(place / "out.raw").data, found)
