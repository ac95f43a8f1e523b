"""The yield with better parts, predicted from the samples that were drawn.

In the same sample a part with a smaller tolerance deviates less. The outputs at rest then move by
their analytic sensitivities, and every other limited reading by its regression on the deviation
over the samples, where that is significant. So the prediction starts from what each sample
measured, and needs no new simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.variation import Parameter, draw
from taction.system.array_types import Bools, Floats
from taction.system.reading_definitions import READINGS
from taction.verification.studies.tolerance.rest_slopes import rest_slopes
from taction.verification.studies.tolerance.varied_board import BoardSample, Quantity, VariedBoard
from taction.verification.studies.tolerance.yield_report import SIGNIFICANT, limits_of

# Checks that fail because of a reading below: any other failure stays in the prediction.
EXPLAINED = {
    *("steady_state", *READINGS, "stability", "noise"),
}
PREDICTED = (
    *(Quantity(name, kind.unit) for name, kind in READINGS.items()),
    Quantity("growth_rate", "1/s"),
    Quantity("noise", "V"),
)


@dataclass(frozen=True, slots=True, eq=False)
class YieldForecast:
    """Samples as margins of their limits.

    Attributes
    ----------
    varied : tuple of Parameter
        The components.
    z : ndarray (K, P)
        Deviations of the samples, in tolerances.
    margins : ndarray (K, L)
        A sample keeps a limit where its margin is at most 1.
    slopes : ndarray (P, L)
        Change of the margins for a deviation of one tolerance.
    lost : ndarray of bool (K,)
        Samples that fail, or have no verdict, for a reason that the margins do not show.
    """

    varied: tuple[Parameter, ...]
    z: Floats
    margins: Floats
    slopes: Floats
    lost: Bools

    @classmethod
    def of(cls, board: VariedBoard, samples: list[BoardSample], seed: int) -> YieldForecast:
        """Take the samples of a study.

        Raises
        ------
        EngineError
            The nominal board has no equilibrium.
        """
        tolerances = board.scene.tolerances
        z = np.array([draw(tolerances, board.varied, seed, sample.number) for sample in samples])
        channels = len(board.nominal.outputs)
        nowhere = (math.nan,) * channels
        errors = np.array([sample.errors or nowhere for sample in samples])
        checks = board.scene.checks
        # Beyond the band of the settling time nothing settles.
        limit = min(checks.steady_state.tolerance, checks.settling_time.band)
        rest = rest_slopes(board) / board.step_amplitude / limit
        margins, slopes = [errors / limit, -errors / limit], [rest, -rest]
        for quantity in PREDICTED:
            values = np.array([_number(sample.value(quantity.name)) for sample in samples])
            for margin in _margins(values, *limits_of(board.scene, quantity.name)):
                margins.append(margin[:, None])
                slopes.append(_regression(z, margin)[:, None])
        table = np.concatenate(margins, axis=1)
        return cls(board.varied, z, table, np.concatenate(slopes, axis=1), _lost(samples, table))

    def better(self, tolerances: dict[int, float]) -> YieldForecast:
        """Return the samples with smaller tolerances of some components, by their places.

        Each component may change once.
        """
        places = list(tolerances)
        shares = np.array([self._share(place, tolerances[place]) for place in places])
        moved = (self.z[:, places] * shares) @ self.slopes[places]
        return replace(self, margins=self.margins - moved)

    def _share(self, place: int, tolerance: float) -> float:
        """Return by which share of itself the deviation of a component shrinks."""
        return 1.0 - math.log1p(tolerance) / math.log1p(self.varied[place].tolerance)

    @property
    def passes(self) -> Bools:
        """Which samples keep all limits, (K,)."""
        return np.asarray(~self.lost & ~(np.nan_to_num(self.margins) > 1.0).any(axis=1))

    @property
    def fraction(self) -> float:
        """The predicted yield."""
        return float(self.passes.mean())

    @property
    def excess(self) -> float:
        """By how much the samples exceed their limits, on the average."""
        largest = np.nan_to_num(self.margins).max(axis=1, initial=0.0)
        return float(np.maximum(largest - 1.0, 0.0).mean())


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _margins(values: Floats, least: float | None, most: float | None) -> list[Floats]:
    """Return one margin (K,) for each limit of a reading."""
    known = values[np.isfinite(values)]
    spread = float(known.std()) if len(known) else 0.0
    found = []
    for limit, sign in ((most, 1.0), (least, -1.0)):
        if limit is not None:
            scale = max(abs(limit), spread) or 1.0
            found.append(1.0 + sign * (values - limit) / scale)
    return found


def _regression(z: Floats, values: Floats) -> Floats:
    """Return the significant slopes (P,) of `values` (K,), which may have gaps, on z (K, P)."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(z.shape[1])
    z, values = z[known] - z[known].mean(axis=0), values[known] - values[known].mean()
    squares = np.maximum((z**2).sum(axis=0), 1e-300)
    slopes = (z * values[:, None]).sum(axis=0) / squares
    correlation = slopes * np.sqrt(squares / max(float(values @ values), 1e-300))
    return np.where(np.abs(correlation) > SIGNIFICANT / math.sqrt(len(values)), slopes, 0.0)


def _lost(samples: list[BoardSample], margins: Floats) -> Bools:
    """Return which samples do not pass although the margins do not show why."""
    shown = np.any(margins > 1.0, axis=1)  # False for NaN
    return np.array(
        [
            sample.outcome != "pass" and not (kept and set(sample.failed) <= EXPLAINED)
            for sample, kept in zip(samples, np.asarray(shown).tolist(), strict=True)
        ]
    )
