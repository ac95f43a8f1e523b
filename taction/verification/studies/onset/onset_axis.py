"""Which axes an onset has; a wrong one is found before anything that computes is loaded."""

from __future__ import annotations

from collections.abc import Sequence

from taction.netlist_gen.scene.axes import Over, SweepAxis, look_at_axes
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError


def look_at_onset_axis(scene: Scene, over: str) -> None:
    """Refuse an axis that is wrong as it is written.

    Raises
    ------
    InputError
        As `verification.studies.onset.onset.parse_onset_axis`.
    """
    only_axis(look_at_axes(scene, [over], bare=True), over, default_known=False)


def only_axis(
    groups: Sequence[Sequence[SweepAxis]], over: Over, *, default_known: bool = True
) -> SweepAxis:
    """Return the one axis of an onset; of a key alone the values may not be known yet.

    Raises
    ------
    InputError
        There are several keys, the key does not vary continuously, or it has one value.
    """
    if [len(group) for group in groups] != [1]:
        raise InputError("--over", Complaint("key", repr(over), "onset needs exactly one key"))
    axis = groups[0][0]
    if axis.key.kind != "real":
        accepted = "onset needs a key that varies continuously, such as C or gain"
        raise InputError("--over", Complaint("key", repr(axis.name), accepted))
    known = default_known or not axis.default
    if known and len(set(axis.values)) < 2:
        accepted = f"onset needs a range, such as {axis.name}=LOW:HIGH, or two values"
        raise InputError("--over", Complaint("values", repr(over), accepted))
    return axis
