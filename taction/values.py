"""The public names of values, their makers and the errors."""

from taction.netlist_gen.board.circuit import Circuit as Circuit
from taction.netlist_gen.board.synthesis import synthesise as synthesise
from taction.netlist_gen.deck.deck import write_deck as write_deck
from taction.netlist_gen.scene.loading import load_scene as load_scene
from taction.netlist_gen.scene.scene import Scene as Scene
from taction.system.errors import InputError as InputError
from taction.system.errors import Interrupted as Interrupted
from taction.system.errors import NoVerdictError as NoVerdictError
from taction.system.errors import TactionError as TactionError
from taction.system.waveforms import Waveforms as Waveforms
from taction.verification.verdict.verify import Verdict as Verdict
