"""Where boards with op-amps of one type rest: their input errors differ from part to part.

To first order the outputs at rest are normal: the mean is that of the errors, the variance is the
sum of the squared sensitivities times the variances. A deck has one error of each kind, with one
sign, in all op-amps; where T has entries of both signs these cancel, and in a built board they do
not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from taction.netlist_gen.board.variation import with_input_errors_at
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity

SHARE = 0.95  # of the boards, which keep the stated distance
PROBED = 2.0  # standard deviations: where the first order is compared with an equilibrium
STEPS = 60  # halvings of the interval in which the distance lies
STANDARD = NormalDist()


@dataclass(frozen=True, slots=True, eq=False)
class InputSpread:
    """The outputs at rest of boards whose op-amps differ in their input errors.

    Attributes
    ----------
    mean, sigma : ndarray (N,)
        V.
    curvature : float
        Error of the first order, as a share of a deviation.
    largest : str
        The error that moves the outputs most: an op-amp and its figure.
    assumed : bool
        Whether a sheet lacks a largest size, so that a spread is assumed.
    """

    mean: Floats
    sigma: Floats
    curvature: float
    largest: str
    assumed: bool

    @classmethod
    def of(cls, board: LinearBoard) -> InputSpread | None:
        """Return the spread of a board; None if its op-amps do not vary.

        Raises
        ------
        EngineError
            The board has no equilibrium.

        Notes
        -----
        Costs one dense factorisation of all unknowns, and one equilibrium.
        """
        models = board.circuit.models
        if not any(model.varying for model in models.values()):
            return None
        if not board.circuit.is_small_signal:
            small = {name: model.small_signal for name, model in models.items()}
            board = LinearBoard(replace(board.circuit, models=small))
        slopes = RestSensitivity.of(board).input_errors()
        spreads = {
            f"{cell.name}.{figure}": (each, _value(models[cell.model], figure))
            for cell in board.circuit.opamps
            for figure, each in models[cell.model].varying
        }
        moved = sum(slopes[name] * (each.mean - value) for name, (each, value) in spreads.items())
        mean = _outputs(board) + moved
        parts = np.array([slopes[name] * each.sigma for name, (each, _) in spreads.items()])
        sigma = np.sqrt((parts**2).sum(axis=0))
        worst = int(np.argmax(sigma))
        largest = list(spreads)[int(np.argmax(np.abs(parts[:, worst])))]
        curvature = 0.0
        if sigma[worst] > 0.0:
            z = PROBED * parts[:, worst] / sigma[worst]
            there = with_input_errors_at(board.circuit, dict(zip(spreads, z.tolist(), strict=True)))
            off = _outputs(LinearBoard(there)) - mean - parts.T @ z
            curvature = float(np.abs(off).max()) / (PROBED * float(sigma[worst]))
        assumed = any(each.assumed for each, _ in spreads.values())
        return cls(mean, sigma, curvature, largest, assumed)

    def distance(self, target: Floats) -> tuple[float, float]:
        """Return how far the outputs rest from `target` (N,) in all but 5 % of the boards, V.

        No channel of such a board is farther away. The second number bounds the error. The channels
        are taken as if one failed without the others, so the distance is never too small.

        Examples
        --------
        >>> one = InputSpread(np.zeros(1), np.ones(1), 0.0, "v_1.offset_voltage", False)
        >>> round(one.distance(np.zeros(1))[0], 4)
        1.96
        """
        away = self.mean - target
        low, high = 0.0, float(np.abs(away).max() + 8.0 * self.sigma.max(initial=0.0))
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            low, high = (
                (low, middle) if self._outside(away, middle) <= 1.0 - SHARE else (middle, high)
            )
        deviation = float(np.abs(away).max()) + float(self.sigma.max(initial=0.0))
        return high, self.curvature * deviation + high * 2.0**-40

    def _outside(self, away: Floats, distance: float) -> float:
        """Return the sum over the channels of the share of boards beyond `distance`."""
        total = 0.0
        for mean, sigma in zip(away.tolist(), self.sigma.tolist(), strict=True):
            if sigma > 0.0:
                total += STANDARD.cdf((-distance - mean) / sigma)
                total += STANDARD.cdf((mean - distance) / sigma)
            else:
                total += float(abs(mean) > distance)
        return total


def _value(model: OpAmp, figure: str) -> float:
    """Return an error as it is in the macromodel, in the units of its spread."""
    return model.rejection_error if figure == "common_mode_rejection" else getattr(model, figure)


def _outputs(board: LinearBoard) -> Floats:
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])
