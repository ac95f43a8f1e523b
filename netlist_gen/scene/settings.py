"""Other values for single keys of a scene (``verify --set KEY=VALUE``)."""

from __future__ import annotations

from collections.abc import Iterable

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import Value, find_key, read_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError

OPAMP = (
    "design.opamp"  # a preset in the place of the table has its own figures, none of the scene's
)


def with_settings(scene: Scene, settings: Iterable[str]) -> Scene:
    """Return `scene` with the values of texts ``KEY=VALUE``; the last one of a key wins.

    A key is named as for an axis (`axes`). ``design.opamp=NAME`` replaces the whole op-amp by a
    preset, ``opamp=NAME`` only its base, as an axis does.

    Raises
    ------
    InputError
        No ``KEY=VALUE``, an unknown key, or a value that its key does not accept.

    Examples
    --------
    >>> from taction.netlist_gen.scene.file import load_scene
    >>> scene = load_scene("scenes/paper-breadboard.toml")
    >>> with_settings(scene, ["C=12pF", "lambda=0.5"]).design.capacitance
    1.2e-11
    """
    changes: dict[str, Value] = {}
    for text in settings:
        name, _, body = (part.strip() for part in text.partition("="))
        if not (name and body):
            accepted = "expected KEY=VALUE, such as C=12pF or lambda=0.5"
            raise InputError("--set", Complaint("setting", repr(text), accepted))
        try:
            if name == OPAMP:
                changes[OPAMP] = body
            else:
                key = find_key(scene, name)
                changes[key.path] = read_value(key, body)
        except InputError as error:
            raise InputError("--set", *error.complaints) from None
    return with_values(scene, changes)
