"""The public names of values, their makers and the errors."""

from netlist_gen.board.circuit import Circuit as Circuit
from netlist_gen.board.synthesis import synthesise as synthesise
from netlist_gen.deck.deck import write_deck as write_deck
from netlist_gen.scene.file import load_scene as load_scene
from netlist_gen.scene.scene import Scene as Scene
from spice_models.errors import InputError as InputError
from spice_models.errors import NoVerdictError as NoVerdictError
from spice_models.errors import TactionError as TactionError
from verification.waveforms import Waveforms as Waveforms
