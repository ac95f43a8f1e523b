"""The public names of taction, each loaded when it is first used.

Every job takes `scene`, a path or a `Scene`, first, and all other arguments by keyword. A keyword
means the same in every job: `over` gives axes, `engine` replaces the scene's own engine, `strains`
gives several right-hand sides for one board, `output` names a file, `jobs` and `cluster` choose the
processes, and `progress` is a function that receives a line of text at every stage.

>>> import taction
>>> verdict = taction.verify("scenes/paper-breadboard.toml", engine="statespace")
>>> verdict.outcome.value
'pass'
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taction.decks import check
    from taction.designs import bom, build, kicad, netlist, solve
    from taction.netlist_gen.board.circuit import Circuit
    from taction.netlist_gen.board.synthesis import synthesise
    from taction.netlist_gen.deck.deck import write_deck
    from taction.netlist_gen.scene.loading import load_scene
    from taction.netlist_gen.scene.scene import Scene
    from taction.searches import choose, new, scale, tune
    from taction.studies import accuracy, onset, regress, reproduce, stress, sweep
    from taction.system.errors import InputError, Interrupted, NoVerdictError, TactionError
    from taction.system.waveforms import Waveforms
    from taction.tolerances import corners, montecarlo, verify_sample
    from taction.tools import doctor, import_model, mcp, models, opamp, scene_schema
    from taction.transients import diff, explore, simulate, verify, verify_files, what_to_change
    from taction.verification.verdict.verify import Verdict

__all__ = [
    "Circuit",
    "InputError",
    "Interrupted",
    "NoVerdictError",
    "Scene",
    "TactionError",
    "Verdict",
    "Waveforms",
    "accuracy",
    "bom",
    "build",
    "check",
    "choose",
    "corners",
    "demo",
    "diff",
    "doctor",
    "explore",
    "import_model",
    "kicad",
    "load_scene",
    "mcp",
    "models",
    "montecarlo",
    "netlist",
    "new",
    "onset",
    "opamp",
    "regress",
    "reproduce",
    "scale",
    "scene_schema",
    "simulate",
    "solve",
    "stress",
    "sweep",
    "synthesise",
    "tune",
    "verify",
    "verify_files",
    "verify_sample",
    "what_to_change",
    "write_deck",
]

# The quickest to load first.
_MODULES = (
    "designs",
    "transients",
    "decks",
    "studies",
    "tolerances",
    "searches",
    "tools",
    "values",
)


def __getattr__(name: str) -> Any:
    """Load a public name at its first use (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    modules = (import_module(f"{__name__}.{module}") for module in _MODULES)
    globals()[name] = next(getattr(module, name) for module in modules if hasattr(module, name))
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
