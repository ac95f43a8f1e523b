"""Small decks, and simulators that misbehave, for the tests of the ngspice runner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from taction.netlist_gen.analysis import OperatingPoint, SimulatedDeck, Transient
from taction.verification.engines.ngspice.process import Simulator

TAU = 1e-6

SmallDeck = SimulatedDeck


def transient(
    *cards: str,
    saved: tuple[str, ...] = ("out",),
    stop: float = 5e-6,
    step: float = 1e-8,
    start: str = "uic",
    solver: str = "noopiter",
) -> SmallDeck:
    """An RC step of time constant `TAU` from 1 V, node ``out``, and whatever `cards` add to it."""
    lines = [
        "* taction test",
        "V1 in 0 1.0",
        "R1 in out 1000.0",
        "C1 out 0 1e-09",
        *cards,
        f".options {solver} method=trap reltol=1e-06",
        ".save " + " ".join(f"v({node})" for node in saved),
        f".tran {step!r} {stop!r} 0.0 {step!r} {start}",
        ".end",
    ]
    return SmallDeck("\n".join(lines) + "\n", saved, Transient(stop, step))


def divider() -> SmallDeck:
    text = (
        "* taction test\nV1 in 0 1.0\nR1 in out 1000.0\nR2 out 0 3000.0\n"
        ".save v(out) v(in)\n.op\n.end\n"
    )
    return SmallDeck(text, ("out", "in"), OperatingPoint())


def endless() -> SmallDeck:
    """1e10 steps: hours."""
    return transient(stop=1.0, step=1e-10)


def wrapped(simulator: Simulator, folder: Path, script: str) -> Simulator:
    """A simulator that runs `script` and then the real one (``$NGSPICE``)."""
    path = folder / "wrapper"
    path.write_text(f'#!/bin/sh\nNGSPICE={simulator.executable}\n{script}\nexec $NGSPICE "$@"\n')
    path.chmod(0o755)
    return replace(simulator, executable=str(path))
