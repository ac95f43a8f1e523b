"""What to buy better for a yield: parts with smaller tolerances, predicted and drawn again.

The yield with better parts is predicted from the samples that were drawn. In the same sample a part
with a smaller tolerance deviates less. The outputs at rest then move by their analytic
sensitivities, and every other limited reading by its regression on the deviation over the samples,
where that is significant. So the prediction starts from what each sample measured, and needs no new
simulation.

Few single parts come first: one after the other, always the part that mends most samples, then the
part that brings them closest to their limits. Where a handful does not suffice, every resistor, or
every resistor and capacitor, has to be better. The samples are then drawn again with the smaller
tolerances: the same deviations of the same boards, in smaller units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.board.variation import Parameter, draw, parameters
from taction.system.array_types import Bools, Floats
from taction.system.errors import EngineError
from taction.system.progress import Notice, Progress
from taction.system.reading_definitions import READINGS
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.tolerance.drawing import SampleCollection, draw_samples
from taction.verification.studies.tolerance.samples import BoardSample
from taction.verification.studies.tolerance.steady_directions import rest_slopes
from taction.verification.studies.tolerance.varied_board import VariedBoard
from taction.verification.studies.tolerance.yield_report import (
    MIN_SAMPLES,
    SIGNIFICANT,
    Remedy,
    interval,
    yield_sentence,
)

TARGET = 0.99  # the yield that a remedy is looked for, and wanted from it


# Checks that fail because of a reading below: any other failure stays in the prediction.
EXPLAINED = {
    *("steady_state", *READINGS, "stability", "noise"),
}
PREDICTED = (*READINGS, "growth_rate", "noise")


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
        tolerances = board.tolerances
        z = np.array([draw(tolerances, board.varied, seed, sample.number) for sample in samples])
        channels = len(board.nominal.outputs)
        nowhere = (math.nan,) * channels
        errors = np.array([sample.errors or nowhere for sample in samples])
        checks = board.scene.checks
        # Beyond the band of the settling time nothing settles.
        limit = min(checks.steady_state.tolerance, checks.settling_time.band)
        rest = rest_slopes(board) / board.step_amplitude / limit
        margins, slopes = [errors / limit, -errors / limit], [rest, -rest]
        limits = {quantity.name: quantity.limits for quantity in board.quantities}
        for name in PREDICTED:
            values = np.array([_number(sample.value(name)) for sample in samples])
            for margin in _margins(values, *limits.get(name, (None, None))):
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


GRADES = {"resistor": (0.05, 0.01, 1e-3, 1e-4), "capacitor": (0.1, 0.05, 0.01)}
"""Tolerances that are sold, by kind. Other kinds cannot be bought better."""
WHOLE: tuple[dict[str, int], ...] = (
    {"resistor": 1},
    {"capacitor": 1},
    {"resistor": 1, "capacitor": 1},
    {"resistor": 2},
    {"resistor": 2, "capacitor": 1},
)
"""How many grades better all parts of a kind are, the cheapest first."""
FEW = 6  # single parts at most
CANDIDATES = 40  # components that are tried at each step
AGAIN = 300  # samples that are drawn again at most


def find_remedy(
    board: VariedBoard, samples: list[BoardSample], seed: int, target: float
) -> Remedy | None:
    """Return the smallest change that is predicted to reach `target`.

    Returns
    -------
    Remedy or None
        None with too few samples, and where they reach the target already. A remedy without parts:
        nothing that can be bought better reaches more than the samples do.

    Raises
    ------
    EngineError
        The nominal board has no equilibrium.
    """
    if not _is_needed(samples, target):
        return None
    start = YieldForecast.of(board, samples, seed)
    few = _few(start, target)
    if few.predicted >= target:
        return few
    tried = [few, *_kinds(start, target)]
    enough = [remedy for remedy in tried if remedy.predicted >= target]
    best = enough[0] if enough else max(tried, key=lambda remedy: remedy.predicted)
    if best.predicted <= start.fraction:
        return Remedy({}, {}, target, start.fraction)
    return best


def _is_needed(samples: list[BoardSample], target: float) -> bool:
    return len(samples) >= MIN_SAMPLES and _passed(samples) < target * len(samples)


def _passed(samples: list[BoardSample]) -> int:
    return sum(sample.outcome == "pass" for sample in samples)


def _grade(parameter: Parameter, steps: int = 1) -> float | None:
    """Return the tolerance `steps` grades better than that of a component, if it is sold."""
    below = [t for t in GRADES.get(parameter.kind, ()) if t < 0.99 * parameter.tolerance]
    return below[min(steps, len(below)) - 1] if below else None


def _few(start: YieldForecast, target: float) -> Remedy:
    """Return the best few single parts."""
    now, parts = start, dict[str, float]()
    while now.fraction < target and len(parts) < FEW:
        trials = [
            (name, tolerance, now.better({place: tolerance}))
            for place, name, tolerance in _candidates(now)
            if name not in parts
        ]
        if not trials:
            break
        name, tolerance, following = min(trials, key=lambda trial: _badness(trial[2]))
        if _badness(following) >= _badness(now):
            break
        now, parts[name] = following, tolerance
    return Remedy(parts, {}, target, now.fraction)


def _badness(forecast: YieldForecast) -> tuple[float, float]:
    """Return a sort key: the samples that fail, then by how much."""
    return -forecast.fraction, forecast.excess


def _candidates(now: YieldForecast) -> list[tuple[int, str, float]]:
    """Return place, name and better tolerance of the components behind the failures."""
    failing = ~now.passes & ~now.lost
    worst = np.nan_to_num(now.margins[failing]).argmax(axis=1)
    behind = (now.z[failing] * now.slopes[:, worst].T).sum(axis=0)
    found = []
    for place in np.argsort(-behind, kind="stable")[:CANDIDATES].tolist():
        tolerance = _grade(now.varied[place])
        if tolerance is not None and behind[place] > 0.0:
            found.append((place, now.varied[place].name, tolerance))
    return found


def _kinds(start: YieldForecast, target: float) -> Iterator[Remedy]:
    """Yield the remedies that take better parts of whole kinds, the cheapest first."""
    for steps in WHOLE:
        kinds: dict[str, float] = {}
        for kind, grades in steps.items():
            loosest = [p for p in start.varied if p.kind == kind]
            if loosest and (tolerance := _grade(max(loosest, key=_tolerance), grades)):
                kinds[kind] = tolerance
        chosen = {
            place: kinds[parameter.kind]
            for place, parameter in enumerate(start.varied)
            if parameter.tolerance > kinds.get(parameter.kind, math.inf)
        }
        if len(kinds) == len(steps):
            yield Remedy({}, kinds, target, start.better(chosen).fraction)


def _tolerance(parameter: Parameter) -> float:
    return parameter.tolerance


def improved(board: VariedBoard, remedy: Remedy) -> VariedBoard:
    """Return the board with the tolerances of a remedy."""
    tolerances = board.scene.tolerances
    parts = dict(tolerances.parts)
    for parameter in board.varied:
        if parameter.name in parts and parameter.kind in remedy.kinds:
            parts[parameter.name] = min(parameter.tolerance, remedy.kinds[parameter.kind])
    better = tolerances.model_copy(update={**remedy.kinds, "parts": parts | remedy.parts})
    scene = board.scene.model_copy(update={"tolerances": better})
    return replace(board, scene=scene, varied=parameters(board.nominal, better))


def verified_remedy(
    board: VariedBoard,
    samples: list[BoardSample],
    seed: int,
    workers: Callable[[], AbstractContextManager[Workers]],
    *,
    target: float = TARGET,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Remedy | None:
    """Find a remedy and draw up to `AGAIN` of the samples again with it.

    None where none is needed, and for a board without a nominal equilibrium, whose sensitivities
    are not known.

    Parameters
    ----------
    workers : callable
        Makes the context manager that starts processes, as for `draw_samples`.
    output : path, optional
        The database of the study; it keeps these samples, too.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        As `draw_samples`.
    """
    if _is_needed(samples, target):  # the yield stands there while better parts are looked for
        progress(Notice(yield_sentence(_passed(samples), len(samples))))
    try:
        remedy = find_remedy(board, samples, seed, target)
    except EngineError:
        return None
    if remedy is None or not remedy.what:
        return remedy
    tally = SampleCollection(min(AGAIN, len(samples)))
    label = f"with {remedy.what}"
    draw_samples(improved(board, remedy), seed, tally, workers(), output, progress, label)
    low, high = interval(tally.passed, len(tally.samples))
    return replace(remedy, samples=len(tally.samples), passed=tally.passed, low=low, high=high)
