"""Where boards of the same parts rest: input errors differ from op-amp to op-amp.

To first order the outputs at rest are normal: the mean is that of the errors, the variance is the
sum of the squared sensitivities times the variances. A deck has one error of each kind, with one
sign, in all op-amps; where T has entries of both signs these cancel, and in a built board they do
not. Where a scene asks for temperatures and supply voltages, the changes of the errors with them,
and of the resistors, are further errors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from taction.netlist_gen.board.devices import KINDS
from taction.netlist_gen.board.variation import (
    device_spreads,
    with_input_errors_at,
    with_resistors_at,
)
from taction.spice_models.input_errors import CHANGES
from taction.spice_models.opamp import OpAmp, Spread
from taction.system.array_types import Floats
from taction.system.frozen import frozen
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity

SHARE = 0.95  # of the boards, which keep the stated distance
PROBED = 2.0  # standard deviations: where the first order is compared with an equilibrium
STEPS = 60  # halvings of the interval in which the distance lies
KNOWN = 64  # spreads of boards that are kept
NO_SPREAD = 1e-30  # V: a channel with less is beyond a distance, or it is not


@frozen(eq=False)
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
    moved : ndarray (N,)
        What the changes add to the mean, V; without them the board rests there, too.
    changes : dict of str to float
        How far each kind of change (`CHANGES`, ``"resistor_drift"``, `KINDS` of devices) moves an
        output by itself in all but 5 % of the boards, V.
    """

    mean: Floats
    sigma: Floats
    curvature: float
    largest: str
    assumed: bool
    moved: Floats | float = 0.0
    changes: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, board: LinearBoard, resistors: float = 0.0) -> InputSpread | None:
        """Return the spread of a board; None if its parts do not vary.

        Parameters
        ----------
        resistors : float
            Standard deviation of the change of each resistor by temperature, a fraction.

        Raises
        ------
        EngineError
            The board has no equilibrium.

        Notes
        -----
        Costs one dense factorisation of all unknowns, and one equilibrium.
        """
        models = board.circuit.models
        devices = {name: own for name, own in device_spreads(board.circuit).items() if own}
        if not (resistors or devices or any(model.varying for model in models.values())):
            return None
        if not board.circuit.is_small_signal:
            small = {name: model.small_signal for name, model in models.items()}
            board = LinearBoard(replace(board.circuit, models=small))
        if resistors or devices or board.descriptor.is_large:
            return cls._of(board, resistors, devices)
        outputs = (*board.circuit.outputs, *board.circuit.opamps, *board.circuit.models.values())
        same = board.descriptor.at_rest, _outputs(board).tobytes(), outputs
        found = _KNOWN.pop(same, None) or cls._of(board, resistors, devices)
        while len(_KNOWN) >= KNOWN:
            _KNOWN.pop(next(iter(_KNOWN)), None)
        _KNOWN[same] = found
        return found

    @classmethod
    def _of(
        cls, board: LinearBoard, resistors: float, devices: Mapping[str, Mapping[str, float]]
    ) -> InputSpread:
        """Return the spread of a board at the small-signal level; `devices` are their spreads."""
        models = board.circuit.models
        sensitivity = RestSensitivity.of(board)
        slopes, own = sensitivity.input_errors(), _resistor_slopes(sensitivity, resistors)
        programmed = _device_slopes(sensitivity, devices)
        spreads = {
            f"{cell.name}.{figure}": (each, _value(models[cell.model], figure))
            for cell in board.circuit.opamps
            for figure, each in models[cell.model].varying
        } | dict.fromkeys(own, (Spread(0.0, resistors), 0.0))
        spreads |= {
            f"{name}.{kind}": (Spread(0.0, share), 0.0)
            for name, shares in devices.items()
            for kind, share in shares.items()
        }
        slopes |= own | programmed
        shifts = np.array([slopes[name] * (each.mean - at) for name, (each, at) in spreads.items()])
        mean = _outputs(board) + shifts.sum(axis=0)
        parts = np.array([slopes[name] * each.sigma for name, (each, _) in spreads.items()])
        sigma = np.sqrt((parts**2).sum(axis=0))
        worst = int(np.argmax(sigma))
        largest = list(spreads)[int(np.argmax(np.abs(parts[:, worst])))]
        curvature = 0.0
        if sigma[worst] > 0.0:
            z = PROBED * parts[:, worst] / sigma[worst]
            deviations = dict(zip(spreads, z.tolist(), strict=True))
            scale = {name: math.exp(resistors * deviations[name]) for name in own}
            for name, shares in devices.items():
                off = sum(share * deviations[f"{name}.{kind}"] for kind, share in shares.items())
                scale[name] = scale.get(name, 1.0) * math.exp(off)
            there = with_input_errors_at(with_resistors_at(board.circuit, scale), deviations)
            off = _outputs(LinearBoard(there)) - mean - parts.T @ z
            curvature = float(np.abs(off).max()) / (PROBED * float(sigma[worst]))
        assumed = any(each.assumed for each, _ in spreads.values())
        kinds = np.array(["resistor_drift" if n in own else n.split(".")[1] for n in spreads])
        moved, changes = np.zeros(len(sigma)), {}
        for kind in (*CHANGES, "resistor_drift", *KINDS):
            if (here := kinds == kind).any():
                shift, deviation = shifts[here].sum(axis=0), (parts[here] ** 2).sum(axis=0)
                moved += shift
                alone = cls(shift, np.sqrt(deviation), 0.0, "", assumed)
                changes[kind] = alone.distance(np.zeros(len(sigma)))[0]
        return cls(mean, sigma, curvature, largest, assumed, moved, changes)

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
        parts = (0.0, self.moved) if np.any(self.moved) else (0.0,)
        return max(self._distance(self.mean - part - target) for part in parts)

    def _distance(self, away: Floats) -> tuple[float, float]:
        """Return the distance, and its error, for means that are `away` (N,), V."""
        size = math.sqrt(2.0) * np.maximum(self.sigma, NO_SPREAD)
        means, scale = np.concatenate([away, -away]) / np.tile(size, 2), (1.0 / size).tolist() * 2
        low, high = 0.0, float(np.abs(away).max() + 8.0 * self.sigma.max(initial=0.0))
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            each = zip(means.tolist(), scale, strict=True)
            beyond = 0.5 * sum(math.erfc(middle * factor - mean) for mean, factor in each)
            low, high = (low, middle) if beyond <= 1.0 - SHARE else (middle, high)
        deviation = float(np.abs(away).max()) + float(self.sigma.max(initial=0.0))
        return high, self.curvature * deviation + high * 2.0**-40


_KNOWN: dict[tuple[bytes, bytes, tuple[object, ...]], InputSpread] = {}
"""Of the last boards; those of a study that differ in capacitances alone have one spread."""


def _resistor_slopes(sensitivity: RestSensitivity, sigma: float) -> dict[str, Floats]:
    """Return the slopes with the logarithms of the resistors, V, (N,); none without a spread."""
    return sensitivity.resistors() if sigma else {}


def _device_slopes(
    sensitivity: RestSensitivity, spreads: Mapping[str, Mapping[str, float]]
) -> dict[str, Floats]:
    """Return the slopes with the logarithms of the devices, V, (N,), by names and kinds."""
    slopes = sensitivity.resistors() if spreads else {}
    return {f"{name}.{kind}": slopes[name] for name, own in spreads.items() for kind in own}


def _value(model: OpAmp, figure: str) -> float:
    """Return an error as it is in the macromodel, in the units of its spread."""
    if figure in CHANGES:
        return 0.0
    return model.rejection_error if figure == "common_mode_rejection" else getattr(model, figure)


def _outputs(board: LinearBoard) -> Floats:
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])
