"""How far an unstable board is from stability: the nearest stable range of each key.

The loci of C find every crossing of the imaginary axis over C; poles on a grid, and halving, find
the nearest edge over another key. Lambda, and with it the solution, stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from taction.netlist_gen.scene.keys import Key, find_key, own_value
from taction.system.errors import InputError, NoVerdictError
from taction.verification.design.trials import OutOfTimeError, Trials
from taction.verification.stability.margin import signal_capacitors
from taction.verification.stability.parameter_loci import trace_loci
from taction.verification.stability.poles import poles
from taction.verification.stability.port_response import PortResponse
from taction.verification.studies.onset.onset import EXACT

REACH = 100.0  # the search goes from the scene's value divided by it to the value times it
STEPS = 6  # per decade, of the search over a key other than C
TOLERANCE = 1e-5  # relative width of the bracket of an edge
CAPACITANCE = "design.capacitance"
AXES = (
    CAPACITANCE,
    "design.gain",
    "design.stray_capacitance",
    "design.opamp.gbw",
)


@dataclass(frozen=True, slots=True)
class StableRange:
    """The stable range of one key that is nearest to the scene's value.

    Attributes
    ----------
    path, unit : str
        The key, and its SI unit.
    own : float
        The scene's value.
    least, most : float
        Ends of the search.
    low, high : float or None
        Ends of the stable range: crossings of the imaginary axis, or None where the range goes on
        beyond the search. Both are None without a stable range.
    found : bool
        Whether there is a stable range.
    reason : str
        Why the range is not known, or empty.
    """

    path: str
    unit: str
    own: float
    least: float
    most: float
    low: float | None = None
    high: float | None = None
    found: bool = False
    reason: str = ""

    @property
    def edge(self) -> float | None:
        """The end of the range that is nearest to the scene's value."""
        edges = [edge for edge in (self.low, self.high) if edge is not None]
        return min(edges, key=lambda edge: abs(math.log(edge / self.own)), default=None)

    @property
    def factor(self) -> float | None:
        """The factor from the scene's value to stability."""
        return None if self.edge is None else self.edge / self.own


def stable_ranges(trials: Trials, paths: Iterable[str] = AXES) -> tuple[StableRange, ...]:
    """Return the nearest stable range of each key that has a positive value in the scene.

    Of C both ends are known; of other keys the end next to the scene's value. A stable range of
    such a key that is narrower than the steps of the search may be missed.

    Notes
    -----
    Costs the loci of C (seven channels: 0.1 s), and the poles of 15 to 40 boards for every other
    key (0.2 s); what the time limit of `trials` leaves out has its `reason`.

    Examples
    --------
    >>> import taction
    >>> from taction.netlist_gen.scene.axes import with_value
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> unstable = Trials(with_value(scene, "design.capacitance", 5e-12))
    >>> found = stable_ranges(unstable, ["design.capacitance"])[0]
    >>> print(f"stable from {found.low:.3g} F")
    stable from 9.02e-12 F
    """
    found, paths = [], tuple(paths)
    for number, path in enumerate(paths):
        key = find_key(trials.scene, path)
        own = own_value(trials.scene, key)
        if own is None or not 0.0 < own < math.inf:
            continue
        trials.share(len(paths) - number)
        found.append(_range(trials, key, own))
    return tuple(found)


def _range(trials: Trials, key: Key, own: float) -> StableRange:
    least, most = own / REACH, own * REACH
    try:
        ranges = _by_loci(trials, own) if key.path == CAPACITANCE else None
        if ranges is None:
            ranges = _by_steps(trials, key, own)
    except OutOfTimeError:
        reason = "the time limit left it out"
        return StableRange(key.path, key.unit, own, least, most, reason=reason)
    except (InputError, NoVerdictError) as error:
        return StableRange(key.path, key.unit, own, least, most, reason=str(error))
    if not ranges:
        return StableRange(key.path, key.unit, own, least, most)
    low, high = min(ranges, key=lambda ends: _distance(ends, own))
    low_end, high_end = (low if low > least else None), (high if high < most else None)
    return StableRange(key.path, key.unit, own, least, most, low_end, high_end, found=True)


def _by_loci(trials: Trials, own: float) -> list[tuple[float, float]] | None:
    """Return the stable ranges of C by the loci of C; None where the loci leave a doubt."""
    board = trials.board_at({CAPACITANCE: own, **EXACT[CAPACITANCE]})
    found = poles(board)
    if not (found.complete and found.certain):
        return None
    ports = PortResponse(board, signal_capacitors(board.circuit))
    loci = trace_loci(ports, 1.0 / REACH, REACH)
    if loci.near:
        return None
    crossings = sorted(loci.crossings, key=lambda crossing: crossing.share)
    unstable = found.unstable_count + sum(c.change for c in crossings if c.share < 1.0)
    edges = [1.0 / REACH, *(c.share for c in crossings), REACH]
    ranges = []
    for k, (low, high) in enumerate(pairwise(edges)):
        if k > 0:
            unstable -= crossings[k - 1].change
        if unstable == 0:
            ranges.append((low * own, high * own))
    return ranges


def _by_steps(trials: Trials, key: Key, own: float) -> list[tuple[float, float]]:
    """Return the nearest stable range by the poles on both sides in turns, if there is one."""
    exact = EXACT.get(key.path, {})

    def stable(place: float) -> bool:
        try:
            found = poles(trials.board_at({**exact, key.path: own * math.exp(place)}))
        except (InputError, NoVerdictError):
            return False
        return found.stable and found.certain

    reach, step = math.log(REACH), math.log(10.0) / STEPS
    for number in range(round(reach / step)):
        for side in (1.0, -1.0):
            inside, outside = side * (number + 1) * step, side * number * step
            if stable(inside):
                while abs(inside - outside) > TOLERANCE:
                    middle = 0.5 * (inside + outside)
                    inside, outside = (middle, outside) if stable(middle) else (inside, middle)
                edge = own * math.exp(inside)
                return [(edge, own * REACH) if side > 0.0 else (own / REACH, edge)]
    return []


def _distance(ends: tuple[float, float], own: float) -> float:
    return max(math.log(ends[0] / own), math.log(own / ends[1]), 0.0)
