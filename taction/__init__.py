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

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taction.designs import bom as bom
    from taction.designs import build as build
    from taction.designs import check as check
    from taction.designs import import_model as import_model
    from taction.designs import netlist as netlist
    from taction.designs import opamp as opamp
    from taction.designs import solve as solve
    from taction.netlist_gen.board.circuit import Circuit as Circuit
    from taction.netlist_gen.board.synthesis import synthesise as synthesise
    from taction.netlist_gen.deck.deck import write_deck as write_deck
    from taction.netlist_gen.scene.open_tables import models as models
    from taction.netlist_gen.scene.scene import Scene as Scene
    from taction.netlist_gen.scene.scene import load_scene as load_scene
    from taction.netlist_gen.scene.scene import scene_schema as scene_schema
    from taction.system.array_types import Waveforms as Waveforms
    from taction.system.errors import InputError as InputError
    from taction.system.errors import Interrupted as Interrupted
    from taction.system.errors import NoVerdictError as NoVerdictError
    from taction.system.errors import TactionError as TactionError
    from taction.transients import diff as diff
    from taction.transients import explore as explore
    from taction.transients import simulate as simulate
    from taction.transients import verify as verify
    from taction.transients import verify_files as verify_files
    from taction.transients import what_to_change as what_to_change
    from taction.verification.design.choose import choose as choose
    from taction.verification.design.fresh_scene import new as new
    from taction.verification.design.scaling import scale as scale
    from taction.verification.design.tune import tune as tune
    from taction.verification.evidence.demonstration import demo as demo
    from taction.verification.evidence.paper.reproduce import reproduce as reproduce
    from taction.verification.evidence.stress.run_cases import stress as stress
    from taction.verification.report.tool_server import mcp as mcp
    from taction.verification.studies.onset import onset as onset
    from taction.verification.studies.regression.regress import regress as regress
    from taction.verification.studies.sweep import sweep as sweep
    from taction.verification.studies.tolerance.corners import corners as corners
    from taction.verification.studies.tolerance.montecarlo import montecarlo as montecarlo
    from taction.verification.studies.work_precision import accuracy as accuracy
    from taction.verification.verdict.verify import Verdict as Verdict

# Each public name with its module: the imports above are the one table of them.
_PLACES = {
    name: place
    for place, name in re.findall(r"from (\S+) import (\w+) as", Path(__file__).read_text("utf-8"))
}
__all__ = sorted(_PLACES)


def __getattr__(name: str) -> Any:
    """Load a public name at its first use (PEP 562)."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(_PLACES[name]), name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
