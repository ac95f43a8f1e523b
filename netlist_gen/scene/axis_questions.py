"""Ranges of a study that are accepted but look like a slip."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from taction.netlist_gen.scene.axes import Axis, with_value
from taction.netlist_gen.scene.questions import value_questions
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import show


def axis_questions(scene: Scene, groups: Iterable[Iterable[Axis]]) -> Iterator[str]:
    """Yield what may be a slip in the axes of a study: falling ranges, values that no board has.

    Examples
    --------
    >>> import taction
    >>> from taction.netlist_gen.scene.axes import parse_axes
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> print(*axis_questions(scene, parse_axes(scene, "C=1nF:1pF:4")))
    --over C: the range falls from 1 nF to 1 pF; are its bounds swapped?
    """
    own = set(value_questions(scene))
    for axis in (axis for group in groups for axis in group):
        first, last = axis.values[0], axis.values[-1]
        if axis.scale != "list" and float(first) > float(last):
            start, end = (show(float(value), axis.key.unit) for value in (first, last))
            text = f"the range falls from {start} to {end}; are its bounds swapped?"
            yield f"--over {axis.name}: {text}"
        found = [
            text
            for value in dict.fromkeys((first, last))
            for text in value_questions(with_value(scene, axis.key.path, value))
        ]
        yield from (f"--over {axis.name}: {text}" for text in found if text not in own)
