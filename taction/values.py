"""The public names that are neither jobs nor the verdict: values, their makers, the errors."""

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.deck import write_deck
from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import Scene
from spice_models.errors import InputError, NoVerdictError, TactionError
from verification.waveforms import Waveforms

__all__ = [
    "Circuit",
    "InputError",
    "NoVerdictError",
    "Scene",
    "TactionError",
    "Waveforms",
    "load_scene",
    "synthesise",
    "write_deck",
]
