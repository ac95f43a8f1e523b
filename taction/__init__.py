"""The public names of taction, each loaded when it is first used.

Every job takes `scene`, a path or a `Scene`, first, and the rest by keyword. A keyword means the
same in every job: `over` the axes, `engine` an engine in the place of the scene's own, `strains`
several right-hand sides for one board, `output` a file, `jobs` and `cluster` where the work is
done, `progress` a function that receives a line of text at every stage.

>>> import taction
>>> verdict = taction.verify("scenes/paper-breadboard.toml", engine="statespace")
>>> verdict.outcome.value
'pass'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

    from netlist_gen.board.circuit import Circuit
    from netlist_gen.board.synthesis import synthesise
    from netlist_gen.deck.deck import write_deck
    from netlist_gen.scene.file import load_scene
    from netlist_gen.scene.scene import Scene
    from spice_models.errors import InputError, NoVerdictError, TactionError
    from taction.designs import netlist, solve
    from taction.studies import montecarlo, onset, sweep
    from taction.transients import simulate, verify
    from taction.verdict import Verdict
    from verification.waveforms import Waveforms

__all__ = [
    "Circuit",
    "InputError",
    "NoVerdictError",
    "Scene",
    "TactionError",
    "Verdict",
    "Waveforms",
    "load_scene",
    "montecarlo",
    "netlist",
    "onset",
    "simulate",
    "solve",
    "sweep",
    "synthesise",
    "verify",
    "write_deck",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = next(getattr(module, name) for module in _modules() if hasattr(module, name))
    globals()[name] = value
    return value


def _modules() -> Iterator[ModuleType]:
    """Import and yield the modules that hold the public names, the quickest to load first."""
    from taction import designs, studies, transients

    yield from (designs, transients, studies)
    from taction import values

    yield values
    from taction import verdict

    yield verdict


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
