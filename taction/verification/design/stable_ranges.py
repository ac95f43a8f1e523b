"""How far an unstable board is from stability: the nearest stable range of each key.

Lambda, and with it the solution, stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.keys import find_key, own_value
from taction.system.errors import InputError, NoVerdictError
from taction.verification.design.trials import OutOfWorkError, Trials, knobs_with_margin
from taction.verification.stability.edge_search import find_edges
from taction.verification.stability.edges import Edges
from taction.verification.stability.families import Family, unrounded

REACH = 100.0  # the search goes from the scene's value divided by it to the value times it
POINTS = 25  # over a key that is no knob of the board
OTHERS = ("design.stray_capacitance", "design.opamp.gbw")  # keys beside the knobs with a margin


@dataclass(frozen=True, slots=True)
class StableRange:
    """The stable range of one key that is nearest to the scene's value.

    Its ends are crossings of the imaginary axis, or None where it goes on beyond the search.
    """

    DOCUMENT = (
        *("path", "unit", "own", "least # the search began here", "most # and ended here"),
        *("low", "high", "found", "reason", "edge", "factor # from the own value to the edge"),
        *("text = verification.report.views.design_view:distance_text()", "doubt = ''"),
    )

    path: str
    unit: str
    own: float  # the scene's value
    least: float  # ends of the search
    most: float
    low: float | None = None
    high: float | None = None
    found: bool = False
    reason: str = ""  # why the range is not known

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

    Without `paths` the keys are those of the knobs with a margin, and `OTHERS`. What the work of
    `trials` leaves out has its `reason`. Costs the loci of C (seven channels: 0.1 s), and the poles
    of some 50 boards for every other key (0.2 s).

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
    found = []
    for path in tuple(paths) or (*knobs_with_margin(trials.scene), *OTHERS):
        key = find_key(trials.scene, path)
        own = own_value(trials.scene, key)
        if own is not None and 0.0 < own < math.inf:
            empty = StableRange(key.path, key.unit, own, own / REACH, own * REACH)
            try:
                found.append(_nearest(empty, _edges(trials, key.path, own)))
            except OutOfWorkError:
                text = "not searched: the work of the search was used up"
                found.append(replace(empty, reason=text))
            except (InputError, NoVerdictError) as error:
                found.append(replace(empty, reason=str(error)))
    return tuple(found)


def _nearest(empty: StableRange, edges: Edges) -> StableRange:
    """Return the stable range that is nearest to the scene's value; without one `empty`."""

    def distance(ends: tuple[float, float]) -> float:
        return max(math.log(ends[0] / empty.own), math.log(empty.own / ends[1]), 0.0)

    nearest = min(edges.stable_ranges, key=distance, default=None)
    if nearest is None:
        return empty
    low, high = nearest
    low_end, high_end = (low if low > edges.low else None), (high if high < edges.high else None)
    return replace(empty, low=low_end, high=high_end, found=True)


def _edges(trials: Trials, path: str, own: float) -> Edges:
    """Return the edges over a key; poles at samples decide where the loci leave a doubt."""
    exact = unrounded(trials.scene, path)

    def build(value: float) -> Circuit:
        return trials.board_at({**exact, path: value}).circuit

    boards = Family.over(build, path, own)
    if boards.ports is not None and boards.poles(own).certain:
        edges = find_edges(boards, own / REACH, own * REACH)
        if not edges.near:
            return edges
    values = np.geomspace(own / REACH, own * REACH, POINTS).tolist()
    return boards.scan(values, fine=False)
