"""The outputs of a linear board over a window of time, from its exact solution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import Initial, LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales
from taction.verification.engines.statespace.transients.exact import Exact, exact_solution

POINTS = 500  # of a curve without fast ringing
PER_PERIOD = 20.0  # points of a curve with ringing, before it is thinned
MOST = 20_000  # points of a curve
RISEN, TIMES_RISE = 0.9, 6.0  # of a channel's step; the window of the rise in times of it
SEARCHED = 400  # instants at which the rise is looked for
EARLIEST = 1e-5  # of the record: the first of them


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Outputs of every channel.

    Attributes
    ----------
    time, outputs : ndarray (P,) and (P, N)
        s and V.
    rise, stop : float
        Ends of the window of the first rise and of the whole record, s.
    """

    time: Floats
    outputs: Floats
    rise: float
    stop: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearResponse:
    """The step response of a linear board of some channels, at any instant.

    Attributes
    ----------
    rise, stop : float
        As in `Curves`.
    """

    solution: Exact
    signs: Floats
    scales: TimeScales
    rise: float
    stop: float

    @classmethod
    def of(
        cls, board: LinearBoard, scales: TimeScales, stop: float, initial: Initial
    ) -> LinearResponse:
        """Solve a small linear board; raises `EngineError` as `exact_solution`."""
        solution = exact_solution(board, initial=initial, stop=stop)
        signs = np.array([output.sign for output in board.circuit.outputs])
        return cls(solution, signs, scales, _rise(solution, stop), stop)

    def curves(self, end: float) -> Curves:
        """Return the outputs from 0 to `end`, s, with `PER_PERIOD` points a period of ringing."""
        period = min((r.period for r in self.scales.ringing), default=math.inf)
        wanted = PER_PERIOD * end / period if period > 0.0 else 0.0
        count = int(min(max(wanted, POINTS), MOST))
        step = end / (count - 1)
        with np.errstate(over="ignore", invalid="ignore"):
            values = self.solution.uniform(step, count) * self.signs
        return Curves(np.linspace(0.0, end, count), values, self.rise, self.stop)


def _rise(solution: Exact, stop: float) -> float:
    """Return the end of a window that shows the first rise of every channel, s."""
    times = np.geomspace(EARLIEST * stop, stop, SEARCHED)
    with np.errstate(over="ignore", invalid="ignore"):
        moved = np.abs(solution.at(times) - solution.start)
    steps = np.abs(solution.final - solution.start)
    large = steps > 0.05 * steps.max(initial=0.0)
    if not large.any():
        return stop
    reached = moved[:, large] >= RISEN * steps[large]
    first = times[np.where(reached.any(axis=0), reached.argmax(axis=0), SEARCHED - 1)]
    return min(TIMES_RISE * float(first.max()), stop)
