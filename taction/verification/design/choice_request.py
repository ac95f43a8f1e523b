"""What a choice is asked for; a mistake is found before anything that computes is loaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from taction.netlist_gen.scene.axes import LIMITS, Point
from taction.netlist_gen.scene.open_tables import NAMES
from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction, number

EVERY = "all"
POINTS = 9  # of C and of the gain


@dataclass(frozen=True, slots=True)
class ChoiceRequest:
    """What is asked for.

    Attributes
    ----------
    opamps : sequence of str
        Presets; empty for all of them.
    capacitances, gains : str
        Ranges ``"LOW:HIGH"``, or empty.
    points : int
        Values of C and of the gain, before they are rounded to their series.
    limits : mapping
        Values of the scene by dotted paths: limits of the checks, and the supply.
    topologies : sequence of str
        Names, or `EVERY`; empty for that of the scene.
    """

    opamps: Sequence[str] = ()
    capacitances: str = ""
    gains: str = ""
    points: int = POINTS
    limits: Point | None = None
    topologies: Sequence[str] = ()


def request_of(
    opamps: str | Sequence[str],
    capacitances: str,
    gains: str,
    points: int,
    topology: str | Sequence[str] = "",
    **limits: str | float | None,
) -> ChoiceRequest:
    """Return what is asked for, from the arguments of `taction.choose`.

    Raises
    ------
    InputError
        A topology is unknown, or the overshoot or the margin is no number.
    """
    names, topologies = (
        [name.strip() for name in (text.split(",") if isinstance(text, str) else text)]
        for text in (opamps, topology)
    )
    for name in topologies:
        if name not in ("", EVERY):
            _refuse_unknown(name)
    numbers = ("overshoot", "margin")
    values = {
        path: _number(f"--{name}", limits[name]) if name in numbers else limits[name]
        for name, path in LIMITS.items()
    }
    return ChoiceRequest(
        opamps=[*filter(None, names)],
        capacitances=capacitances,
        gains=gains,
        points=points,
        limits={path: value for path, value in values.items() if value is not None},
        topologies=[*filter(None, topologies)],
    )


def _number(option: str, given: str | float | None) -> float | None:
    """Read a number; of the overshoot also a share in percent."""
    if given is None:
        return None
    text = str(given).strip()
    try:
        return fraction(text) if option == "--overshoot" else number(text)
    except ValueError:
        complaint = Complaint("value", repr(given), "expected a number, such as 0.05 or 5%")
        raise InputError(option, complaint) from None


def _refuse_unknown(name: str) -> None:
    try:
        NAMES["topology"].check(name)
    except ValueError as error:
        raise InputError("--topology", Complaint("NAME", repr(name), str(error))) from None
