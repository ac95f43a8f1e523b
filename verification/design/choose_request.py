"""The grid of a choice: op-amp presets, C and gain; lambda is held, limits are checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.buyable_values import buyable, series_of
from taction.netlist_gen.scene.axes import Axis, Point, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value, find_key, own_value, read_value
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError
from taction.verification.design.trials import at_small_signal
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.studies.sweep.plan import Plan

OPAMP, CAPACITANCE, GAIN = "design.opamp.base", "design.capacitance", "design.gain"
AROUND = 10.0  # C and gain go from the scene's value divided by it to the value times it
POINTS = 9  # of C and of the gain
MOST_POINTS = 101


@dataclass(frozen=True, slots=True)
class Request:
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
    """

    opamps: Sequence[str] = ()
    capacitances: str = ""
    gains: str = ""
    points: int = POINTS
    limits: Point | None = None


def request_of(
    opamps: str | Sequence[str],
    capacitances: str,
    gains: str,
    points: int,
    **limits: str | float | None,
) -> Request:
    """Return what is asked for, from the arguments of `taction.choose`.

    Raises
    ------
    InputError
        The overshoot or the margin is no number.
    """
    names = opamps.split(",") if isinstance(opamps, str) else opamps
    values = {
        "checks.settling_time.max": limits["settling"],
        "checks.rise_time.max": limits["rise"],
        "checks.overshoot.max": _number("--overshoot", limits["overshoot"]),
        "checks.noise.max": limits["noise"],
        "checks.stability.margin": _number("--margin", limits["margin"]),
        "design.supply": limits["supply"],
    }
    return Request(
        opamps=[name.strip() for name in names if name.strip()],
        capacitances=capacitances,
        gains=gains,
        points=points,
        limits={path: value for path, value in values.items() if value is not None},
    )


def _number(option: str, given: str | float | None) -> float | None:
    """Read a number; of the overshoot also a share in percent."""
    if given is None:
        return None
    text = str(given).strip()
    percent = option == "--overshoot" and text.endswith("%")
    try:
        return float(text.removesuffix("%")) / 100.0 if percent else float(text)
    except ValueError:
        complaint = Complaint("value", repr(given), "expected a number, such as 0.05 or 5%")
        raise InputError(option, complaint) from None


def choice_plan(scene: Scene, request: Request) -> Plan:
    """Return the sweep of a choice by the state-space engine.

    Op-amps are at the small-signal level: a design above 90 % of a limit of its parts is
    inconclusive, so that no design without headroom is chosen.

    Parameters
    ----------
    scene : Scene
        Lambda is a number.

    Raises
    ------
    InputError
        An op-amp is unknown, a range is none, or a limit is no value of its key.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/tuned-breadboard.toml")
    >>> plan = choice_plan(scene, Request(["tl084", "ne5534"], "10pF:40pF", "1M:2M", 3))
    >>> plan.shape, plan.axes[1].values
    ((2, 3, 3), (1e-11, 2e-11, 4e-11))
    """
    names = request.opamps or [name for name, o in OPAMPS.items() if math.isfinite(o.gbw)]
    lam = ideal_network(make_problem(scene), scene).lam
    limits = {path: value for path, value in (request.limits or {}).items() if value is not None}
    base = with_values(scene, {**limits, "design.lambda": lam, "design.opamp": names[0]})
    for name in names:
        with_values(base, {OPAMP: name})
    axes = [
        Axis(find_key(base, OPAMP), "opamp", tuple(dict.fromkeys(names)), "list"),
        _axis(base, CAPACITANCE, "C", request.capacitances, request.points),
        _axis(base, GAIN, "gain", request.gains, request.points),
    ]
    return Plan(at_small_signal(base), [[axis] for axis in axes], ("statespace",))


def _axis(scene: Scene, path: str, name: str, text: str, points: int) -> Axis:
    key = find_key(scene, path)
    own = own_value(scene, key) or 1.0
    low, high = own / AROUND, own * AROUND
    if text:
        first, colon, last = text.partition(":")
        low, high = (float(read_value(key, part)) for part in (first, last if colon else first))
    if not (0.0 < low <= high and 1 <= points <= MOST_POINTS):
        accepted = f"expected LOW:HIGH above zero, and 1 to {MOST_POINTS} points"
        raise InputError(f"--{name.lower()}-range", Complaint(path, repr(text), accepted))
    spaced = np.geomspace(low, high, points if low < high else 1).tolist()
    series = series_of(scene.design, path)
    values: list[Value] = [buyable(value, series) for value in spaced]
    return Axis(key, name, tuple(dict.fromkeys(values)), "log")
