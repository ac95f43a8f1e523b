"""Where built boards rest: input errors and parts differ from board to board.

To first order an output at rest is a sum: each part adds its slope times its deviation. Deviations
are normal, but those of parts with a uniform tolerance. The distance that 95 % of the boards keep,
and the share of boards within a limit, are those of `DRAWN` such sums. In a deck the errors of all
op-amps have one sign and can cancel, in a built board they do not.
"""

from __future__ import annotations

import functools
import math
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from taction.netlist_gen.board.arrays import KINDS
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import (
    DEVICE,
    DYNAMIC,
    INPUT_ERROR,
    Parameter,
    device_spreads,
    parameters,
    vary,
    with_factors,
)
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.spice_models.input_errors import CHANGES, MOST
from taction.system.array_types import Bools, Floats
from taction.system.quantities import percent, show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity

SHARE = 0.95  # of the boards, which keep the stated distance
PROBED = 2.0  # standard deviations: where the first order is compared with an equilibrium
DRAWN = 2**14  # sums
SURE = 3.0  # standard deviations of the scatter of a drawn share, in its bound
DIFFERENCED = 1e-3  # of a tolerance: the error of a central difference is its square
SINGLE = 0.02  # of a variance: a uniform part with more is drawn by itself, the others as normal
KEPT = 32  # spreads of the last boards
_FOUND: dict[bytes, InputSpread | None] = {}
DRIFT = "resistor_drift"  # a kind of deviation: of a resistor by temperature
NOTHING = Tolerances(
    resistor=0.0, capacitor=0.0, stray=0.0, opamp_gbw=0.0, opamp_gain=0.0, distribution="normal"
)
"""Of a board whose parts have their nominal values."""


class Deviation(NamedTuple):
    """How a part differs from board to board, and what it moves the outputs by."""

    part: str
    kind: str
    row: Floats  # (N,): change of the outputs for one standard deviation, V
    size: float  # one standard deviation: of ln R, or in the z of `vary`
    shift: Floats = np.zeros(1)  # (N,): what the mean less the value on the board adds, V

    @property
    def name(self) -> str:
        """The part, with its figure: ``"v_1.offset_voltage"``."""
        return f"{self.part}.{self.kind}" if self.kind not in (DRIFT, "") else self.part


@dataclass(frozen=True, eq=False)
class InputSpread:
    """The outputs at rest of boards whose op-amps, or parts, differ."""

    mean: Floats  # (N,): V
    rows: Floats  # (P, N): what each deviation adds for one standard deviation, V
    uniform: int = 0  # so many of the last rows are uniform, all others normal
    curvature: float = 0.0  # error of the first order, as a share of a deviation
    moved: Floats | float = 0.0  # (N,): what the changes of temperature and supply add to the mean
    names: tuple[str, ...] = ()  # (P,): what deviates

    @classmethod
    def of(
        cls, board: LinearBoard, resistors: float = 0.0, tolerances: Tolerances = NOTHING
    ) -> InputSpread | None:
        """Return the spread of a board; None if nothing varies that moves its rest.

        `resistors`: standard deviation of the change of each resistor by temperature, a fraction.
        EngineError: the board has no equilibrium. InputError: a tolerance is of no part of it.
        """
        models = board.circuit.models
        varied = () if tolerances is NOTHING else parameters(board.circuit, tolerances)
        at_rest = [p for p in varied if p.kind not in (INPUT_ERROR, DEVICE, *DYNAMIC)]
        devices = any(device_spreads(board.circuit).values())
        if not (resistors or devices or at_rest or any(m.varying for m in models.values())):
            return None
        if not board.circuit.is_small_signal:
            small = {name: model.small_signal for name, model in models.items()}
            board = LinearBoard(replace(board.circuit, models=small))

        def at(shares: Mapping[str, float]) -> Circuit:
            """Return the board with these z of `vary`."""
            every = parameters(board.circuit, tolerances)
            z = np.array([shares.get(each.name, 0.0) for each in every])
            return vary(board.circuit, tolerances, z)

        sensitivity, uniform = RestSensitivity.of(board), tolerances.distribution == "uniform"
        size = 1.0 / (math.sqrt(3.0) if uniform else MOST)
        every = [
            *_deviations(board.circuit, sensitivity, resistors),
            *tolerance_deviations(sensitivity, at_rest, at, size),
        ]
        rest = outputs_at_rest(board)
        found = cls(
            sum((each.shift for each in every), rest),
            np.array([each.row for each in every]),
            len(at_rest) if uniform else 0,
            names=tuple(each.name for each in every),
            moved=sum((d.shift for d in every if d.kind in CHANGES), np.zeros_like(rest)),
        )
        worst = int(np.argmax(found.sigma))
        sigma, column = float(found.sigma[worst]), found.rows[:, worst]
        if not sigma > 0.0:
            return found
        # The first order is compared with the rest of a board whose worst output is far off.
        z, shares, logs = PROBED * column / sigma, dict[str, float](), dict[str, float]()
        for each, value in zip(every, z.tolist(), strict=True):
            if each.kind == DRIFT or each.kind in KINDS:  # ln R deviates
                logs[each.part] = logs.get(each.part, 0.0) + each.size * value
            else:
                shares[each.name] = each.size * value
        scale = {name: math.exp(value) for name, value in logs.items()}
        probed = outputs_at_rest(LinearBoard(with_factors(at(shares), scale)))
        off = float(np.abs(probed - found.mean - found.rows.T @ z).max())
        return replace(found, curvature=off / (PROBED * sigma))

    @classmethod
    def shared(cls, board: LinearBoard, *more: Any) -> InputSpread | None:
        """Return the same as `of`; points of a sweep that differ in capacitors alone share it."""
        models, matrices = board.circuit.models.values(), board.circuit.matrices
        if not any(each.varying for each in models) or any(each.device for each in matrices):
            return cls.of(board, *more)
        circuit = replace(board.circuit, name="", capacitors=(), facts={}, roles={}, knobs=())
        key = pickle.dumps((circuit, more))
        if key not in _FOUND:
            if len(_FOUND) == KEPT:
                del _FOUND[next(iter(_FOUND))]
            _FOUND[key] = cls.of(board, *more)
        return _FOUND[key]

    @functools.cached_property
    def sigma(self) -> Floats:
        """The standard deviations of the outputs (N,), V."""
        return np.asarray(np.sqrt((self.rows**2).sum(axis=0)))

    def distance(self, target: Floats, share: float = SHARE) -> tuple[float, float]:
        """Return how far from `target` (N,) a share of the boards rests, and its error, V."""
        found, ranks = [], DRAWN * (share + self._scatter(share) * np.array([-1.0, 0.0, 1.0]))
        for farthest, error in self._farthest(target):
            places = np.ceil(ranks).astype(np.int64) - 1
            low, middle, high = np.partition(farthest, places)[places].tolist()
            found.append((middle, max(high - middle, middle - low) + error))
        return max(found)

    def within(self, target: Floats, limit: float) -> float:
        """Return an upper bound on the share of boards that rest within `limit`, V, of `target`."""
        found = [float((far <= limit + error).mean()) for far, error in self._farthest(target)]
        return min(1.0, *(share + self._scatter(share) for share in found))

    def _farthest(self, target: Floats) -> Iterator[tuple[Floats, float]]:
        """Yield how far drawn boards rest off `target`, and the error of the first order, V.

        The means are those with the changes of temperature and supply, and those without.
        """
        for part in (0.0, self.moved) if np.any(self.moved) else (0.0,):
            away = self.mean - part - target
            size = float(np.abs(away).max() + self.sigma.max(initial=0.0))
            yield np.abs(away[:, None] + self._sums).max(axis=0), self.curvature * size

    @functools.cached_property
    def _independent(self) -> tuple[Floats, Floats]:
        """The uniform deviations that are drawn, (Q, N), and the normal ones, (at most N, N), V."""
        single: Bools = np.any(self.rows**2 > SINGLE * self.sigma**2, axis=1)
        single[: len(single) - self.uniform] = False
        normal = np.linalg.qr(self.rows[~single], mode="r")
        return math.sqrt(3.0) * self.rows[single], np.asarray(normal)

    @functools.cached_property
    def _sums(self) -> Floats:
        """Drawn sums of all deviations, (N, DRAWN), V."""
        uniform, normal = self._independent
        found = uniform.T @ _standard(len(uniform), "uniform")
        return np.asarray(found + normal.T @ _standard(len(normal), "normal"))

    def _scatter(self, share: float) -> float:
        """Return the bound on the scatter of a drawn share; one deviation has its own quantiles."""
        if sum(map(len, self._independent)) == 1:
            return 1.0 / DRAWN
        return SURE * math.sqrt(max(share * (1.0 - share), 1.0 / DRAWN) / DRAWN)


@functools.lru_cache(maxsize=8)
def _standard(count: int, distribution: str) -> Floats:
    """Return deviations (count, DRAWN), normal or uniform to ±1, by a Latin hypercube."""
    own = (np.arange(DRAWN) + 0.5) / DRAWN
    if distribution == "normal":  # scipy.special would take a fifth of a verdict to import
        own = np.array([*map(NormalDist().inv_cdf, own.tolist())])
    else:
        own = 2.0 * own - 1.0
    seed = 95 if distribution == "normal" else 96  # drawn independently of each other
    drawn = np.random.default_rng(seed).permuted(np.tile(own, (count, 1)), axis=1)
    if distribution == "uniform" or not count:
        return np.asarray(drawn)
    lower = np.linalg.cholesky(drawn @ drawn.T / DRAWN)
    return np.asarray(np.linalg.solve(lower, drawn))  # their covariance is 1


def tolerance_deviations(
    sensitivity: RestSensitivity,
    parts: Sequence[Parameter],
    at: Callable[[Mapping[str, float]], Circuit],
    size: float,
) -> Iterator[Deviation]:
    """Yield the deviations of parts with tolerances; one standard deviation is `size` of them.

    Where a slope is not analytic, the equations of the board `at` a deviation are differenced.
    """
    known = sensitivity.resistors() | sensitivity.gains() if parts else {}
    for part in parts:
        if part.kind in ("resistor", "opamp_gain") and part.name in known:
            slope = known[part.name] * math.log1p(part.tolerance)
        else:
            ends = (sensitivity.towards(at({part.name: z})) for z in (DIFFERENCED, -DIFFERENCED))
            slope = (next(ends) - next(ends)) / (2.0 * DIFFERENCED)
        yield Deviation(part.name, "", size * slope, size)


def _deviations(
    circuit: Circuit, sensitivity: RestSensitivity, resistors: float
) -> Iterator[Deviation]:
    """Yield input errors and their changes, the drift of resistors, and devices of arrays."""
    errors = sensitivity.input_errors()
    for cell in circuit.opamps:
        model = circuit.models[cell.model]
        for figure, each in model.varying:
            shift, slope = each.mean, errors[f"{cell.name}.{figure}"]
            if figure not in CHANGES:  # the board has the error, in the units of its spread
                name = {"common_mode_rejection": "rejection_error"}.get(figure, figure)
                shift -= getattr(model, name)
            yield Deviation(cell.name, figure, slope * each.sigma, 1.0 / MOST, slope * shift)
    devices = device_spreads(circuit)
    slopes = sensitivity.resistors() if resistors or devices else {}
    for name, slope in slopes.items() if resistors else ():
        yield Deviation(name, DRIFT, slope * resistors, resistors)
    for name, shares in devices.items():
        for kind, share in shares.items():
            yield Deviation(name, kind, slopes[name] * share, share)


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
