"""Reading a scene for a command, with the options that change it."""

from __future__ import annotations

from netlist_gen.scene import Scene
from netlist_gen.scene_file import load_scene
from verification.lambda_rule import resolve_lambda


def read_scene(path: str, engine: str | None = None) -> Scene:
    """Read the scene at `path`, its lambda as a number; `engine` replaces its own.

    Raises
    ------
    InputError, SolverError
        See `netlist_gen.scene_file.load_scene` and `verification.lambda_rule.resolve_lambda`.
    """
    scene = resolve_lambda(load_scene(path))
    if engine is None:
        return scene
    analysis = scene.analysis.model_copy(update={"engine": engine})
    return scene.model_copy(update={"analysis": analysis})
