"""Where built boards rest: input errors and parts differ from board to board.

To first order an output at rest is a sum: each part adds its slope times its deviation. Deviations
are normal, but those of parts with a uniform tolerance. The distance that 95 % of the boards keep,
and the share of boards within a limit, are those of `DRAWN` such sums. In a deck the errors of all
op-amps have one sign and can cancel, in a built board they do not.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.devices import KINDS
from taction.netlist_gen.board.variation import (
    DEVICE,
    DYNAMIC,
    INPUT_ERROR,
    Parameter,
    device_spreads,
    parameters,
    vary,
    with_resistors_at,
)
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.spice_models.input_errors import CHANGES, MOST
from taction.system.array_types import Floats
from taction.system.quantities import percent, show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity

SHARE = 0.95  # of the boards, which keep the stated distance
PROBED = 2.0  # standard deviations: where the first order is compared with an equilibrium
DRAWN = 2**14  # sums
SURE = 3.0  # standard deviations of the scatter of a drawn share, in its bound
DIFFERENCED = 1e-3  # of a tolerance: the error of a central difference is its square
SINGLE = 0.02  # of a variance: a uniform part with more is drawn by itself, the others as normal
DRIFT = "resistor_drift"  # a kind of deviation: of a resistor by temperature
NOTHING = Tolerances(
    resistor=0.0, capacitor=0.0, stray=0.0, opamp_gbw=0.0, opamp_gain=0.0, distribution="normal"
)
"""Of a board whose parts have their nominal values."""


_LAST: dict[tuple[object, ...], InputSpread] = {}
"""Of the last board: those of a study that differ in capacitances alone have one spread."""


@dataclass(frozen=True, eq=False)
class InputSpread:
    """The outputs at rest of boards whose op-amps, or parts, differ."""

    mean: Floats  # (N,): V
    parts: Floats  # (P, N): what each normal deviation adds for one standard deviation, V
    curvature: float  # error of the first order, as a share of a deviation
    largest: str  # what moves the outputs most: a part, or an op-amp and its figure
    assumed: bool  # whether a sheet lacks a largest size, so that a spread is assumed
    moved: Floats | float = 0.0  # (N,): what the changes of temperature and supply add to the mean
    # How far each kind of change (`CHANGES`, `DRIFT`, `KINDS` of devices) moves an output by itself
    # in all but 5 % of the boards, V.
    changes: Mapping[str, float] = field(default_factory=dict)
    ends: Floats | None = None  # (Q, N): what uniform deviations add at the end of a tolerance, V

    @classmethod
    def of(
        cls, board: LinearBoard, resistors: float = 0.0, tolerances: Tolerances = NOTHING
    ) -> InputSpread | None:
        """Return the spread of a board; None if nothing varies that moves its rest.

        `resistors`: standard deviation of the change of each resistor by temperature, a fraction.
        EngineError: the board has no equilibrium. InputError: a tolerance is of no part of it.
        """
        models = board.circuit.models
        devices = {name: own for name, own in device_spreads(board.circuit).items() if own}
        varied = () if tolerances is NOTHING else parameters(board.circuit, tolerances)
        at_rest = [p for p in varied if p.kind not in (INPUT_ERROR, DEVICE, *DYNAMIC)]
        if not (resistors or devices or at_rest or any(m.varying for m in models.values())):
            return None
        if not board.circuit.is_small_signal:
            small = {name: model.small_signal for name, model in models.items()}
            board = LinearBoard(replace(board.circuit, models=small))
        outputs, parts_of = outputs_at_rest(board), (*board.circuit.outputs, *board.circuit.opamps)
        plain = not (resistors or devices or at_rest or board.descriptor.is_large)
        alike = board.descriptor.at_rest, outputs.tobytes(), parts_of, tuple(models.values())
        if plain and alike in _LAST:
            return _LAST[alike]
        sensitivity = RestSensitivity.of(board)
        normal = [*_deviations(board.circuit, sensitivity, resistors, devices)]
        count, uniform = len(outputs), tolerances.distribution == "uniform" and bool(at_rest)

        def varied_by(z: Mapping[str, float]) -> Circuit:
            every = parameters(board.circuit, tolerances)
            drawn = np.array([z.get(each.name, 0.0) for each in every])
            return vary(board.circuit, tolerances, drawn)

        shifts = np.array([each.slope * each.shift for each in normal]).reshape(-1, count)
        parts = np.array([each.slope * each.sigma for each in normal]).reshape(-1, count)
        ends = tolerance_slopes(sensitivity, at_rest, lambda name, z: varied_by({name: z}))
        size = math.sqrt(3.0) if uniform else MOST  # of a tolerance, in standard deviations
        every = np.concatenate([parts, ends / size])
        found = cls(
            outputs + shifts.sum(axis=0),
            parts if uniform else every,
            0.0,
            "",
            any(each.assumed for model in models.values() for _, each in model.varying),
            ends=ends if uniform else None,
        )
        worst = int(np.argmax(found.sigma))
        curvature = 0.0
        if found.sigma[worst] > 0.0:
            z = PROBED * every[:, worst] / found.sigma[worst]
            shares, scale = _deviated(normal, at_rest, z, size)
            probed = LinearBoard(with_resistors_at(varied_by(shares), scale))
            off = outputs_at_rest(probed) - found.mean - every.T @ z
            curvature = float(np.abs(off).max()) / (PROBED * float(found.sigma[worst]))
        moved, changes = np.zeros(count), dict[str, float]()
        for kind in (*CHANGES, DRIFT, *KINDS):
            here = np.array([each.kind == kind for each in normal], dtype=np.bool_)
            if here.any():
                shift = shifts[here].sum(axis=0)
                moved += shift
                alone = cls(shift, parts[here], 0.0, "", False)
                changes[kind] = alone.distance(np.zeros(count))[0]
        names = [f"{each.part}.{each.kind}".removesuffix(f".{DRIFT}") for each in normal]
        names += [part.name for part in at_rest]
        largest = names[int(np.argmax(np.abs(every[:, worst])))]
        found = replace(found, curvature=curvature, largest=largest, moved=moved, changes=changes)
        if plain:
            _LAST.clear()
            _LAST[alike] = found
        return found

    @functools.cached_property
    def sigma(self) -> Floats:
        """The standard deviations of the outputs (N,), V."""
        uniform = 0.0 if self.ends is None else (self.ends**2).sum(axis=0) / 3.0
        return np.asarray(np.sqrt((self.parts**2).sum(axis=0) + uniform))

    def distance(self, target: Floats, share: float = SHARE) -> tuple[float, float]:
        """Return how far from `target` (N,) a share of the boards rests, and its error, V."""
        return max(self._distance(away, share) for away in self._away(target))

    def within(self, target: Floats, limit: float) -> tuple[float, float]:
        """Return bounds on the share of boards that rest at most `limit`, V, off `target`."""
        found = []
        for away in self._away(target):
            farthest, error = np.abs(away + self._sums).max(axis=1), self._first_order(away)
            ends = [float((farthest <= limit + sign * error).mean()) for sign in (-1.0, 1.0)]
            low, high = (self._scatter(end) for end in ends)
            found.append((max(ends[0] - low, 0.0), ends[1] + high))
        least, most = min(found)
        return least, min(most, 1.0)

    def _away(self, target: Floats) -> list[Floats]:
        """Return how far the means are from `target`, with and without the changes, V."""
        parts = (0.0, self.moved) if np.any(self.moved) else (0.0,)
        return [self.mean - part - target for part in parts]

    def _distance(self, away: Floats, share: float) -> tuple[float, float]:
        """Return the distance, and its error, for means that are `away` (N,), V."""
        farthest = np.sort(np.abs(away + self._sums).max(axis=1))
        ranks = DRAWN * (share + self._scatter(share) * np.array([-1.0, 0.0, 1.0]))
        low, middle, high = farthest[np.ceil(ranks).astype(np.int64) - 1].tolist()
        return middle, max(high - middle, middle - low) + self._first_order(away)

    def _first_order(self, away: Floats) -> float:
        """Return the error of the first order, V."""
        return self.curvature * float(np.abs(away).max() + self.sigma.max(initial=0.0))

    @functools.cached_property
    def _independent(self) -> tuple[Floats, Floats]:
        """The uniform deviations that are drawn, (Q, N), and the normal ones, (at most N, N), V."""
        normal, uniform = self.parts, np.zeros((0, len(self.mean)))
        if self.ends is not None:
            single = (self.ends**2 > 3.0 * SINGLE * self.sigma**2).any(axis=1)
            normal = np.concatenate([normal, self.ends[~single] / math.sqrt(3.0)])
            uniform = self.ends[single]
        return uniform, np.asarray(np.linalg.qr(normal, mode="r"))

    @functools.cached_property
    def _sums(self) -> Floats:
        """Drawn sums of all deviations, (DRAWN, N), V."""
        uniform, normal = self._independent
        found = _standard(len(uniform), "uniform") @ uniform
        return np.asarray(found + _standard(len(normal), "normal") @ normal)

    def _scatter(self, share: float) -> float:
        """Return the bound on the scatter of a drawn share; one deviation has its own quantiles."""
        if sum(map(len, self._independent)) == 1:
            return 1.0 / DRAWN
        return SURE * math.sqrt(max(share * (1.0 - share), 1.0 / DRAWN) / DRAWN)


@functools.lru_cache(maxsize=8)
def _standard(count: int, distribution: str) -> Floats:
    """Return deviations (DRAWN, count), normal or uniform to ±1, by a Latin hypercube."""
    from scipy.special import ndtri

    shares = np.tile((np.arange(DRAWN)[:, None] + 0.5) / DRAWN, count)
    seed = 95 if distribution == "normal" else 96  # drawn independently of each other
    shares = np.random.default_rng(seed).permuted(shares, axis=0)
    if distribution == "uniform" or not count:
        return 2.0 * shares - 1.0
    drawn = np.asarray(ndtri(shares))
    lower = np.linalg.cholesky(drawn.T @ drawn / DRAWN)
    return np.asarray(np.linalg.solve(lower, drawn.T).T)  # their covariance is 1


def tolerance_slopes(
    sensitivity: RestSensitivity, parts: Sequence[Parameter], at: Callable[[str, float], Circuit]
) -> Floats:
    """Return the change of each output for a deviation of one tolerance, V, (parts, N).

    Where it is not analytic, the equations of the board `at` a deviation are differenced.
    """
    none = np.zeros(len(sensitivity.adjoint))
    known = sensitivity.resistors() | sensitivity.gains() if parts else {}
    errors = sensitivity.input_errors() if parts else {}

    def slope(part: Parameter) -> Floats:
        if part.kind in DYNAMIC:
            return none
        if part.kind == INPUT_ERROR:
            return errors[part.name] * part.tolerance
        if part.kind in ("resistor", "opamp_gain", DEVICE) and part.name in known:
            return known[part.name] * math.log1p(part.tolerance)
        up, down = (sensitivity.towards(at(part.name, z)) for z in (DIFFERENCED, -DIFFERENCED))
        return np.asarray((up - down) / (2.0 * DIFFERENCED))

    return np.array([slope(part) for part in parts]).reshape(-1, len(none))


class _Deviation(NamedTuple):
    """A normal deviation: what it is, what it moves the outputs by, and its size."""

    part: str
    kind: str
    slope: Floats  # (N,): change of the outputs, V per unit
    shift: float  # mean less the value on the board
    sigma: float


def _deviations(
    circuit: Circuit,
    sensitivity: RestSensitivity,
    resistors: float,
    devices: Mapping[str, Mapping[str, float]],
) -> Iterator[_Deviation]:
    """Yield input errors and their changes, the drift of resistors, and devices of arrays."""
    errors = sensitivity.input_errors()
    for cell in circuit.opamps:
        model = circuit.models[cell.model]
        for figure, each in model.varying:
            shift, slope = each.mean, errors[f"{cell.name}.{figure}"]
            if figure not in CHANGES:  # the board has the error, in the units of its spread
                name = {"common_mode_rejection": "rejection_error"}.get(figure, figure)
                shift -= getattr(model, name)
            yield _Deviation(cell.name, figure, slope, shift, each.sigma)
    slopes = sensitivity.resistors() if resistors or devices else {}
    for name, slope in slopes.items() if resistors else ():
        yield _Deviation(name, DRIFT, slope, 0.0, resistors)
    for name, shares in devices.items():
        for kind, share in shares.items():
            yield _Deviation(name, kind, slopes[name], 0.0, share)


def _deviated(
    normal: Sequence[_Deviation], at_rest: Sequence[Parameter], z: Floats, size: float
) -> tuple[dict[str, float], dict[str, float]]:
    """Return deviations in tolerances, of `size`, and factors of resistors, from standard ones."""
    of_parts = zip(at_rest, z[len(normal) :].tolist(), strict=True)
    shares, logs = {part.name: value / size for part, value in of_parts}, dict[str, float]()
    for each, value in zip(normal, z[: len(normal)].tolist(), strict=True):
        if each.kind == DRIFT or each.kind in KINDS:
            logs[each.part] = logs.get(each.part, 0.0) + each.sigma * value
        else:
            shares[f"{each.part}.{each.kind}"] = value / MOST
    return shares, {name: math.exp(value) for name, value in logs.items()}


def covered(circuit: Circuit, tolerances: Tolerances, *, drift: bool = False) -> str:
    """Return what differs between the boards of a spread: ``"resistors 1 %, op-amp errors"``."""
    named = {"resistor": "resistors", "opamp_gain": "op-amp gains"}
    texts = [f"{name} {percent(getattr(tolerances, kind))}" for kind, name in named.items()
             if getattr(tolerances, kind)]  # fmt: skip
    texts += ["single parts"] * bool(tolerances.parts)
    if tolerances.temperature:
        texts.append(f"temperature ±{show(tolerances.temperature, 'K')}")
    texts += ["op-amp input errors"] * any(m.varying for m in circuit.models.values())
    texts += ["programmed devices"] * bool(device_spreads(circuit))
    return ", ".join([*texts, *["drift of the resistors"] * drift])


def outputs_at_rest(board: LinearBoard) -> Floats:
    """Return u of every channel at the equilibrium, V, (N,); `EngineError` without one."""
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])
