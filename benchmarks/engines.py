"""The engine of state space beside ngspice: one transient at equal error, with as many points.

`verify` runs with ``analysis.error = 1e-4``; its last deck is run again. Processor times, that of
state space from the circuit on.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any
from unittest import mock

from benchmarks.measuring import SCENES, Figure, in_turns, processor, ratios
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import load_scene
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.process import find_simulator
from taction.verification.engines.statespace.transients import stepped
from taction.verification.verdict import simulation
from taction.verification.verdict.verify import verify

ERROR = 1e-4  # of the step amplitude
FASTER = {"paper-breadboard": 10.0, "tuned-breadboard": 2.5}  # wanted: ngspice over state space


def measure(tiny: bool) -> list[Figure]:
    """Measure two boards."""
    names = list(FASTER)[1:] if tiny else list(FASTER)
    return [of_board(name, 1 if tiny else 5) for name in names]


def of_board(name: str, rounds: int) -> Figure:
    """Time one transient of a shipped scene by both engines."""
    decks: list[Deck] = []
    own = process.Simulation

    def recorded(deck: Deck, *given: Any, **named: Any) -> Any:
        decks.append(deck)
        return own(deck, *given, **named)

    scene = with_values(load_scene(SCENES / f"{name}.toml"), {"analysis.error": ERROR})
    with mock.patch.object(simulation, "Simulation", recorded):
        verdict = verify(scene.with_engine("ngspice"))
    points = max(verdict.waveforms.cost.points, 2)
    transient = replace(verdict.transient, max_step=verdict.transient.stop / points)
    run = partial(process.simulate, decks[-1], find_simulator(), timeout=600.0)
    jobs = {
        "ngspice": processor(run),
        "statespace": processor(partial(stepped.simulate, verdict.circuit, transient)),
    }
    found = in_turns(jobs, rounds)
    what, base = f"ngspice at an error of {ERROR:g}, {name}", "state space, as many points"
    return Figure(
        what, base, ratios(found["ngspice"], found["statespace"]), FASTER[name], least=True
    )
