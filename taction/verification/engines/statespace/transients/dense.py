"""Dense output of an integration: its solution between the ends of its steps."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.transients.radau import STAGES
from taction.verification.engines.statespace.transients.straight_pieces import Switch

# Error over last Legendre coefficient of a mode much faster than a step: the stages are all at its
# end, so that the coefficient is half of its change; a mode that rings may be off by twice that.
LAYER = 4.0
RESOLVED = 1.0 / 16.0  # of a coefficient: that of half a step which resolves its modes is 1/256


@dataclass(eq=False)
class Dense:
    """Dense output: Legendre coefficients of the watched voltages in every step.

    Attributes
    ----------
    ends : list of float
        0 and the end of every step, s.
    pieces : list of ndarray (W, s + 1)
        Coefficients over a step.
    levels : list of int
        Binary logarithms of the lengths, in units of the base.
    rejected, factorisations : int
        What it cost.
    escaped : bool
        Whether it ended early because a voltage passed its limit.
    rounding : float
        What rounding left where it was more than the tolerance, V.
    coarse : bool
        Whether it was in a step.
    tails : list of float
        The largest last Legendre coefficient of each accepted step, V, without its rounding.
    switches : list of Switch
        The straight pieces of the amplifiers: those of the start, and after each passage of one.
    failure : str
        Why the integration ended without a solution, or empty.
    """

    ends: list[float] = field(default_factory=lambda: [0.0])
    pieces: list[Floats] = field(default_factory=list)
    levels: list[int] = field(default_factory=list)
    rejected: int = 0
    factorisations: int = 0
    escaped: bool = False
    rounding: float = 0.0
    coarse: bool = False
    tails: list[float] = field(default_factory=list)
    switches: list[Switch] = field(default_factory=list)
    failure: str = ""

    def checked(self, board: str) -> Dense:
        """Return this output; raise EngineError, with the name of the board, without a solution."""
        if self.failure:
            raise EngineError(f"board {board!r}: {self.failure}; try --engine ngspice")
        return self

    def unresolved(self, whole: Dense) -> float:
        """Return what fast modes can do within steps that are too long for them, V.

        Half the steps of the run `whole` are too long, too, so the difference of the two runs does
        not show it. In a step that resolves its modes half of it has a far smaller coefficient.
        """
        ends, halves = np.array(self.ends), np.zeros(whole.steps)
        within = np.searchsorted(whole.ends, 0.5 * (ends[:-1] + ends[1:])) - 1
        np.maximum.at(halves, within, self.tails)
        passed = halves > RESOLVED * np.array(whole.tails)
        return LAYER * float(halves.max(initial=0.0, where=passed))

    def level_at(self, t: float) -> int:
        """Return the level of the step at an instant, s."""
        return self.levels[max(min(bisect_right(self.ends, t), self.steps) - 1, 0)]

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return len(self.pieces)

    @cached_property
    def _whole(self) -> tuple[Floats, Floats]:
        """The ends and the coefficients of all steps, of an integration that has ended."""
        return np.array(self.ends), np.stack(self.pieces)

    def at(self, times: Floats) -> Floats:
        """Watched voltages at `times`, shape (P, W)."""
        from numpy.polynomial.legendre import legvander

        ends, pieces = self._whole
        which = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, self.steps - 1)
        theta = (times - ends[which]) / (ends[which + 1] - ends[which])
        basis = legvander(2.0 * theta - 1.0, STAGES)
        return np.asarray((pieces[which] @ basis[:, :, None])[:, :, 0])
