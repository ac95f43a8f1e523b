"""Keys of a scene that keep one value at every point of a study (``--fix``).

::

    --fix lambda        the scene's own lambda, also where the scene gives a resistance
    --fix lambda=0.5    this lambda

In Python: ``"lambda"``, ``["lambda", "C=10pF"]`` or ``{"lambda": 0.5, "C": "10pF"}``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from taction.netlist_gen.scene.axes import REPLACES, Axis
from taction.netlist_gen.scene.keys import Value, find_key, own_value, read_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError

Fixed = str | Iterable[str] | Mapping[str, Value | None]


def fixed_values(scene: Scene, fixed: Fixed) -> dict[str, Value]:
    """Return the fixed values by the dotted paths of their keys.

    Raises
    ------
    InputError
        An unknown key, a value that is not of the key's kind, or a key without a value of its own.
    """
    if isinstance(fixed, Mapping):
        texts = [name if value is None else f"{name}={value}" for name, value in fixed.items()]
    else:
        texts = [fixed] if isinstance(fixed, str) else list(fixed)
    try:
        return dict(_fixed_value(scene, text) for text in texts)
    except InputError as error:
        raise InputError("--fix", *error.complaints) from None


def check_axes(groups: Sequence[Sequence[Axis]], fixed: Mapping[str, Value]) -> None:
    """Refuse an axis that changes a fixed key, or that replaces it.

    Raises
    ------
    InputError
        For the first such axis.
    """
    for axis in (axis for group in groups for axis in group):
        if axis.key.path in fixed:
            text = "the key has one value by --fix; leave out --over or --fix"
            raise InputError("--over", Complaint("key", repr(axis.name), text))
        if (replaced := REPLACES.get(axis.key.path)) in fixed:
            text = f"a value of this key replaces {replaced}, which --fix holds; leave out one"
            raise InputError("--over", Complaint("key", repr(axis.name), text))


def _fixed_value(scene: Scene, text: str) -> tuple[str, Value]:
    name, equals, body = (part.strip() for part in text.partition("="))
    key = find_key(scene, name)
    value = read_value(key, body) if equals else own_value(scene, key)
    if value is None:
        complaint = Complaint("key", repr(name), f"the scene has no number here; give {name}=VALUE")
        raise InputError("--fix", complaint)
    return key.path, value
