"""Put a program that fails in one way where an ngspice is looked for."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from taction.verification.engines.ngspice.executable import Simulator
from tests.support.paths import ROOT


def script(folder: Path, way: str) -> Path:
    """Write the executable of a way; the program may leave files in `folder`."""
    path = folder / "ngspice"
    variables = f"PYTHONPATH={shlex.quote(str(ROOT))} FAULTY_FOLDER={shlex.quote(str(folder))}"
    words = shlex.join([sys.executable, "-S", "-m", "tests.faulty_simulators.program", way])
    path.write_text(f'#!/bin/sh\n{variables} exec {words} "$@"\n')
    path.chmod(0o755)
    return path


def installed(folder: Path, way: str) -> Simulator:
    """Return the simulator of a way, as if its version had been asked for."""
    return Simulator(str(script(folder, way)), 46, klu=True)
