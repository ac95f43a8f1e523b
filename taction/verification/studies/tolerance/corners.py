"""Worst cases within the design tolerances, from the signs of the sensitivities or from a list.

A sensitivity is a difference of two verifications by the state-space engine. In the worst corner of
a quantity every component has the end of its tolerance with the sign of the sensitivity, which is
exact where the quantity is monotonic in each component. Where the first order misses its change,
the sensitivities are taken again at the corner, as long as other ends make it so much worse. The
steady-state error is smallest near the nominal board: the corners of the channels with the largest
signed errors, ``e_n + sum_p |S_pn|`` to first order, are tried. If the corner of one quantity is
worse for another quantity than that quantity's own corner, it is reported for both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.progress import Progress
from taction.system.results import Result
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.cluster import workers_at
from taction.verification.studies.running.study import HERE, Workers
from taction.verification.studies.tolerance.montecarlo import (
    BoardSample,
    Quantity,
    Varied,
    evaluate_all,
    prepare,
)
from taction.verification.verdict.input_spread import outputs_at_rest

PROBE = 0.25  # of the tolerance: large against rounding errors, small against curvature
NOTHING = 1e-9  # of the largest slope of a channel: rounding
NAMED = 5  # components listed with each corner
STEADY_CORNERS = 8  # corners of the steady state that are tried
MISSED, SMALL = 0.1, 1e-4  # of the change, and of the step: errors of the first order that count


@dataclass(frozen=True, slots=True)
class Corner:
    """One corner and its verification."""

    name: str  # "nominal", "worst overshoot", or the user's words
    quantity: str  # of which it is the worst corner, or empty
    result: BoardSample
    largest: tuple[str, ...]  # components with the largest sensitivities, with their signs
    deviations: dict[str, float]  # in tolerances, without the components at their nominal values


@dataclass(frozen=True, slots=True, repr=False)
class CornerStudy(Result):
    """Verified corners of a scene."""

    VIEW = "taction.verification.report.views.tolerance_view:corner_view"
    DOCUMENT = ("scene = name", "corners")

    name: str
    quantities: tuple[Quantity, ...]
    corners: tuple[Corner, ...]
    scene: Scene | None = None

    @property
    def outcome(self) -> str:
        """``fail`` if a corner fails, else ``inconclusive`` if one has no verdict."""
        outcomes = {corner.result.outcome for corner in self.corners}
        bad = "fail" if "fail" in outcomes else "inconclusive"
        return "pass" if outcomes == {"pass"} else bad


def corners(
    scene: str | Path | Scene,
    *,
    corner: Sequence[str | Mapping[str, float]] = (),
    engine: str | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> CornerStudy:
    """Verify SCENE with the components at the ends of their [tolerances].

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    corner : sequence of str or mapping
        Verify this corner only, in units of the tolerances: capacitor=-1,opamp_gbw=-1,Rf_3_5=1.
        Repeat the option for several corners.

        In Python a list of such texts, or of ``{"capacitor": -1.0}``.
    engine : str, optional
        Engine in the place of the scene's own.

        ``"auto"``, ``"ngspice"`` or ``"statespace"``.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    CornerStudy
        The nominal board and the worst corner of every quantity, or the corners that were named.

    Raises
    ------
    InputError
        The scene or the tolerances cannot be used, nothing varies, or a corner is none.
    NoVerdictError
        The problem has no solution, or the cluster is gone.

    Examples
    --------
    >>> import taction
    >>> study = taction.corners("scenes/tuned-breadboard.toml", corner=["capacitor=-1"])
    >>> study.corners[0].name, study.outcome
    ('capacitor=-1', 'pass')
    """
    scene = read_scene(scene, engine)
    named = [_deviations(each) for each in corner]
    board = prepare(scene, full_margin=True)
    if named:
        ends = [(name, _by_name(board, values)) for name, values in named]
        found = _verified(board, ends, HERE, progress, "corners")
        return CornerStudy(board.name, board.quantities, found, scene=scene)
    with workers_at(cluster, jobs, progress) as workers:
        return replace(worst_of(board, workers, progress), scene=scene)


def worst_of(
    board: Varied, workers: Workers, progress: Progress = lambda stage: None
) -> CornerStudy:
    """Return the nominal board, and the worst corner of every quantity."""
    count, reported = len(board.varied), board.quantities
    probes = [("", z) for z in (np.zeros(count), *(PROBE * np.eye(count)))]
    probed = replace(board, engine="statespace")
    centre, *moved = _verified(probed, probes, workers, progress, "sensitivities")
    gradient = {
        quantity.name: np.array([_worse(quantity, each.result, centre.result) for each in moved])
        for quantity in reported
    }
    steady = steady_slopes(board, centre.result, [each.result for each in moved])
    gradient["steady_state"] = steady[0] if steady else np.zeros(count)
    ends = [
        ("nominal", np.zeros(count)),
        *((quantity.name, np.sign(gradient[quantity.name])) for quantity in reported),
        *(("", np.sign(slopes)) for slopes in steady[1:]),
    ]
    nominal, *tried = _verified(board, ends, workers, progress, "corners")
    named = []
    for quantity in reported:
        name, own = quantity.name, _worst(tried, quantity)
        slopes, change = gradient[name], _worse(quantity, own.result, nominal.result)
        known = name == "steady_state" or own.result.value(name) is None
        least = max(MISSED * change, SMALL * (quantity.unit == "step"))
        if not known and abs(change - np.abs(slopes).sum() / PROBE) > least:
            own = _climbed(board, quantity, own, least, workers, progress)
        largest = own.largest or largest_parts(slopes, board, own.deviations)
        named.append(replace(own, name=f"worst {name}", quantity=name, largest=largest))
    return CornerStudy(board.name, reported, (nominal, *named))


def _worst(tried: Iterable[Corner], quantity: Quantity) -> Corner:
    return min(tried, key=lambda c: _goodness(c.result, quantity, c.name))


def _climbed(
    board: Varied, quantity: Quantity, corner: Corner, least: float, workers: Workers, say: Progress
) -> Corner:
    """Return the worse corner that sensitivities there, and at those worse by `least`, lead to."""
    z = np.array([corner.deviations.get(each.name, 0.0) for each in board.varied])
    other, probed = np.where(z, -z, 1.0), replace(board, engine="statespace")
    probes = [("", z), *(("", z + PROBE * step) for step in np.diag(other))]
    centre, *moved = _verified(probed, probes, workers, say, "sensitivities")
    slopes = np.array([_worse(quantity, each.result, centre.result) for each in moved])
    ends = [(corner.name, np.where(slopes > 0.0, other, z))]
    worst = _worst((corner, *_verified(board, ends, workers, say, "corners")), quantity)
    if _worse(quantity, worst.result, corner.result) > least:
        return _climbed(board, quantity, worst, least, workers, say)
    return replace(worst, largest=largest_parts(slopes, board, worst.deviations))


def steady_slopes(board: Varied, centre: BoardSample, moved: Sequence[BoardSample]) -> list[Floats]:
    """Return what each part moves a channel away from the reference at rest, worst channels first.

    Each is the slope of an error in step amplitudes, (components,), times the sign of one side.
    `moved` are the boards with each component in its turn off by `PROBE`. There are no slopes where
    no output has to move: errors are fractions of the largest step.
    """
    if math.isnan(board.step_amplitude):
        return []
    count = len(board.varied)
    probes = zip((centre, *moved), (np.zeros(count), *(PROBE * np.eye(count))), strict=True)
    rest, *ends = (np.array(each.errors or _errors(board, z)) for each, z in probes)
    S = np.array([(end - rest) / PROBE for end in ends]).reshape(count, len(rest))
    S = np.where(np.abs(S) > NOTHING * np.abs(S).max(axis=0, initial=0.0), S, 0.0)
    sides = [
        (sign * error + float(np.abs(column).sum()), sign * column)
        for error, column in zip(rest.tolist(), S.T, strict=True)
        for sign in (1.0, -1.0)
    ]
    sides.sort(key=lambda side: -side[0])
    return [towards for _, towards in sides[:STEADY_CORNERS]]


def largest_parts(
    slopes: Floats, board: Varied, deviations: Mapping[str, float]
) -> tuple[str, ...]:
    """Return the components with the largest `slopes` (components,), and where they deviate to."""
    order = np.argsort(-np.abs(slopes), kind="stable")[:NAMED].tolist()
    moved = [(board.varied[k].name, deviations.get(board.varied[k].name, 0.0)) for k in order]
    return tuple(f"{'+' if z > 0 else '-'}{name}" for name, z in moved if z)


def _errors(board: Varied, z: Floats) -> tuple[float, ...]:
    """Return the errors at rest of a board without a verdict, in step amplitudes."""
    outputs = outputs_at_rest(LinearBoard(board.at(z)))
    return tuple(((outputs - board.target) / board.step_amplitude).tolist())


def _verified(
    board: Varied,
    ends: Sequence[tuple[str, Floats]],
    workers: Workers,
    progress: Progress,
    stage: str,
) -> tuple[Corner, ...]:
    """Verify boards by their names and deviations, in tolerances."""
    samples = dict[int, BoardSample]()
    for sample in evaluate_all(board, enumerate(z for _, z in ends), workers):
        samples[sample.number] = sample
        progress(f"{stage}: {len(samples)} of {len(ends)} boards")
    found = []
    for number, (name, z) in enumerate(ends):
        deviations = {p.name: off for p, off in zip(board.varied, z.tolist(), strict=True) if off}
        found.append(Corner(name, "", samples[number], (), deviations))
    return tuple(found)


def _goodness(sample: BoardSample, quantity: Quantity, corner: str) -> tuple[float, bool]:
    """Return a sort key that is least for the worst sample, then for the quantity's own corner."""
    value = sample.value(quantity.name)
    without = math.inf if sample.lost else -math.inf
    return without if value is None else -quantity.worse * value, corner != quantity.name


def _worse(quantity: Quantity, moved: BoardSample, centre: BoardSample) -> float:
    """Return the change of a quantity, positive if worse; +1 or -1 if only one has it."""
    after, before = moved.value(quantity.name), centre.value(quantity.name)
    if after is None or before is None:
        return float(before is not None) - float(after is not None)
    return quantity.worse * float(after - before)


def _by_name(board: Varied, values: Mapping[str, float]) -> Floats:
    """Return z from deviations in tolerances, by component or else by kind."""
    kinds = sorted({parameter.kind for parameter in board.varied})
    for key in values:
        if key not in (*kinds, *(parameter.name for parameter in board.varied)):
            text = f"neither a component that varies nor one of {', '.join(kinds)}"
            raise InputError("--corner", Complaint(key, "", text))
    return np.array([values.get(p.name, values.get(p.kind, 0.0)) for p in board.varied])


def _deviations(corner: str | Mapping[str, float]) -> tuple[str, Mapping[str, float]]:
    """Return the name of a corner and its deviations, in units of the tolerances."""
    if not isinstance(corner, str):
        return ",".join(f"{key}={value:g}" for key, value in corner.items()), corner
    deviations = {}
    for part in corner.split(","):
        name, _, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.inf
        if not abs(number) <= 100:
            accepted = "expected KEY=Z, Z from -100 to 100 in units of the tolerance: capacitor=-1"
            raise InputError("--corner", Complaint("KEY=Z", repr(part), accepted))
        deviations[name.strip()] = number
    return corner, deviations
