"""How far an unstable board is from stability: the nearest stable range of each key.

Lambda, and with it the solution, stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.keys import Key, find_key, own_value
from taction.system.errors import InputError, NoVerdictError
from taction.verification.design.trials import OutOfWorkError, Trials, knobs_with_margin
from taction.verification.stability.edges import Edges
from taction.verification.stability.families import Family, unrounded

REACH = 100.0  # the search goes from the scene's value divided by it to the value times it
POINTS = 25  # over a key that is no knob of the board
OTHERS = ("design.stray_capacitance", "design.opamp.gbw")  # keys beside the knobs with a margin


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

    DOCUMENT = (
        *("path", "unit", "own", "least # the search began here", "most # and ended here"),
        *("low", "high", "found", "reason", "edge", "factor # from the own value to the edge"),
        *("text = verification.report.views.remedies:distance_text()", "doubt = ''"),
    )

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


def stable_ranges(trials: Trials, paths: Iterable[str] = ()) -> tuple[StableRange, ...]:
    """Return the nearest stable range of each key that has a positive value in the scene.

    Without `paths` the keys are those of the knobs with a margin, and `OTHERS`.

    Notes
    -----
    Costs the loci of C (seven channels: 0.1 s), and the poles of some 50 boards for every other
    key (0.2 s); what the work of `trials` leaves out has its `reason`.

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
    found, paths = [], tuple(paths) or (*knobs_with_margin(trials.scene), *OTHERS)
    for path in paths:
        key = find_key(trials.scene, path)
        own = own_value(trials.scene, key)
        if own is None or not 0.0 < own < math.inf:
            continue
        found.append(_range(trials, key, own))
    return tuple(found)


def _range(trials: Trials, key: Key, own: float) -> StableRange:
    least, most = own / REACH, own * REACH
    try:
        edges = _edges(trials, key, own)
    except OutOfWorkError:
        reason = "not searched: the work of the search was used up"
        return StableRange(key.path, key.unit, own, least, most, reason=reason)
    except (InputError, NoVerdictError) as error:
        return StableRange(key.path, key.unit, own, least, most, reason=str(error))
    if not edges.stable_ranges:
        return StableRange(key.path, key.unit, own, least, most)
    low, high = min(edges.stable_ranges, key=lambda ends: _distance(ends, own))
    low_end, high_end = (low if low > edges.low else None), (high if high < edges.high else None)
    return StableRange(key.path, key.unit, own, least, most, low_end, high_end, found=True)


def _edges(trials: Trials, key: Key, own: float) -> Edges:
    """Return the edges over a key; poles at samples decide where the loci leave a doubt."""
    exact = unrounded(trials.scene, key.path)

    def build(value: float) -> Circuit:
        return trials.board_at({**exact, key.path: value}).circuit

    boards = Family.over(build, key.path, own)
    if boards.ports is not None and boards.poles(own).certain:
        edges = boards.edges(own / REACH, own * REACH)
        if not edges.near:
            return edges
    values = np.geomspace(own / REACH, own * REACH, POINTS).tolist()
    return boards.scan(values, fine=False)


def _distance(ends: tuple[float, float], own: float) -> float:
    return max(math.log(ends[0] / own), math.log(own / ends[1]), 0.0)
