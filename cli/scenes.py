"""Reading a scene for a command, with the options that change it."""

from __future__ import annotations

from netlist_gen.scene import Scene
from netlist_gen.scene_file import load_scene


def read_scene(path: str, engine: str | None = None) -> Scene:
    """Read the scene at `path`; `engine` replaces its own.

    Raises
    ------
    InputError
        See `netlist_gen.scene_file.load_scene`.
    """
    scene = load_scene(path)
    if engine is None:
        return scene
    analysis = scene.analysis.model_copy(update={"engine": engine})
    return scene.model_copy(update={"analysis": analysis})
