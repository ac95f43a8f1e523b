"""The points of a hybrid sweep that ngspice confirms.

A hybrid sweep computes every point of the grid by the state-space engine, and in addition by
ngspice:

- the points next to the stability boundary: of two neighbours on an axis of numbers, one is stable
  and the other is not;
- the points with the least and the greatest value of every reading (`POLE_READINGS` of all points,
  `TRANSIENT_READINGS` of the stable points: those of a growing record depend on its length);
- a random sample of `SHARE` of all points, with the seed `SEED`.

The choice depends only on the stored results of the state-space engine, so an interrupted sweep
continues with the same points. `compare` says whether two engines agree at a point.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.netlist_gen.scene.axes import SweepAxis
from taction.system.array_types import Bools
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan, Requests
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.compare import Difference, compare, within_uncertainties
from taction.verification.verdict.record import ERROR, POLE_READINGS, TRANSIENT_READINGS, Record

OPPOSITE = {Outcome.PASS.value, Outcome.FAIL.value}
APART = 2.0
"""Times both uncertainties: a larger difference of a reading is a disagreement. A bound holds for
at least 99 % of readings; the factor keeps the others from being disagreements."""
BOTH = "engines_agree"  # the check of ngspice's verdict that compares the waveforms


@dataclass(frozen=True, slots=True)
class Comparison:
    """Whether two engines agree at a point.

    Attributes
    ----------
    outcome : Outcome
        Inconclusive if an engine has no verdict, or if the difference cannot be judged.
    difference : float or None
        Largest difference of any output at any time, divided by the error that the run of ngspice
        was allowed (`wanted_error`); None for an unstable board, whose outputs grow.
    reason : str
        Why the engines do not agree; empty if they agree.
    """

    outcome: Outcome
    difference: float | None
    reason: str


def compare_point(ngspice: Record, statespace: Record) -> Comparison:
    """Compare the records of a point.

    The engines disagree if one passes a check that the other fails, if the waveforms differ by more
    than the scene allows, or if a reading differs by more than `APART` times its uncertainties. The
    readings of an unstable board depend on the length of its record and are not compared.
    """
    for record in (ngspice, statespace):
        if record.outcome == ERROR:
            first = record.reason.partition("\n")[0]
            return Comparison(Outcome.INCONCLUSIVE, None, f"no verdict by {record.engine}: {first}")
    attained, wanted = ngspice.value("attained_error"), ngspice.value("wanted_error")
    difference = attained / wanted if attained is not None and wanted else None
    groups = ["checks"] + ["figures"] * bool(ngspice.stable and statespace.stable)
    tolerance = within_uncertainties(APART)
    found = compare(ngspice, statespace, tolerance, groups=groups, figures=TRANSIENT_READINGS)
    judged = [*_waveforms(ngspice), *(pair for each in found for pair in _judged(each))]
    for outcome in (Outcome.FAIL, Outcome.INCONCLUSIVE):
        reasons = [reason for each, reason in judged if each is outcome]
        if reasons:
            return Comparison(outcome, difference, "; ".join(reasons))
    return Comparison(Outcome.PASS, difference, "")


def _waveforms(ngspice: Record) -> Iterator[tuple[Outcome, str]]:
    check = ngspice.check(BOTH)
    if check is not None and check.outcome is not Outcome.PASS:
        yield check.outcome, f"{BOTH}: {check.outcome.value}"


def _judged(found: Difference) -> Iterator[tuple[Outcome, str]]:
    """Yield whether a check or a reading contradicts the agreement of the engines, and how."""
    ours, theirs, name = found.first, found.second, found.name
    if found.group == "checks":
        if {ours, theirs} == OPPOSITE:
            yield Outcome.FAIL, f"{name}: {ours} by ngspice, {theirs} by the state-space engine"
    elif ours is None or theirs is None:
        owner = "the state-space engine" if ours is None else "ngspice"
        yield Outcome.INCONCLUSIVE, f"{name}: only {owner} has this reading"
    elif found.allowed is None:
        yield Outcome.INCONCLUSIVE, f"{name}: no second solution confirms this reading"
    elif found.beyond:
        values = f"{ours:.6g} by ngspice, {theirs:.6g} by the state-space engine"
        text = f"{name} ({found.unit}): {values}, uncertainty {found.allowed / APART:.2g}"
        yield Outcome.FAIL, text


SHARE = 0.05  # of all points
SEED = 1
DIGITS = 6  # readings that agree to so many digits are equal; the first point counts
BOUNDARY, EXTREME, SAMPLE = "boundary", "extreme", "sample"


def confirmed_points(plan: Plan, store: Store) -> dict[int, str]:
    """Return the places of the points for ngspice, in the order of the grid, with the reason.

    The reason is `BOUNDARY`, `EXTREME` or `SAMPLE`; if several apply, the first of them.
    """
    stable = np.zeros(plan.points, dtype=np.int8)  # 1 stable, -1 unstable, 0 not known
    extremes: dict[tuple[str, float], tuple[float, int]] = {}
    for point in Requests(plan, ("statespace",)):
        record = store.record_of(point.request)
        if record is None or record["stable"] is None:
            continue
        stable[point.place] = 1 if record["stable"] else -1
        for name, value in _readings(record):
            for sign in (1.0, -1.0):
                best, _ = extremes.get((name, sign), (math.inf, 0))
                if sign * value < best:
                    extremes[name, sign] = (sign * value, point.place)
    reasons = dict.fromkeys(sample(plan.points), SAMPLE)
    reasons |= dict.fromkeys((place for _, place in extremes.values()), EXTREME)
    boundary = next_to_the_boundary(stable.reshape(plan.shape), plan)
    reasons |= dict.fromkeys(np.flatnonzero(boundary).tolist(), BOUNDARY)
    return dict(sorted(reasons.items()))


def sample(points: int) -> list[int]:
    """Return the places of the random sample of a grid of `points` points."""
    count = math.ceil(SHARE * points)
    return sorted(np.random.default_rng(SEED).permutation(points)[:count].tolist())


def next_to_the_boundary(stable: np.ndarray[Any, Any], plan: Plan) -> Bools:
    """Mark the points with a neighbour of the opposite sign.

    Parameters
    ----------
    stable : ndarray of plan.shape
        Positive for stable, negative for unstable, 0 for unknown points.
    """
    marked = np.zeros(stable.shape, dtype=np.bool_)
    for k, group in enumerate(plan.groups):
        if has_order(group):
            signs, marks = np.moveaxis(stable, k, 0), np.moveaxis(marked, k, 0)  # views
            crossing = np.sign(signs[1:]) * np.sign(signs[:-1]) < 0
            marks[1:] |= crossing
            marks[:-1] |= crossing
    return marked


def has_order(group: Iterable[SweepAxis]) -> bool:
    """Whether neighbouring values of axes that change together are close to each other."""
    return all(axis.key.kind != "choice" for axis in group)


def _readings(record: dict[str, Any]) -> Iterator[tuple[str, float]]:
    names = POLE_READINGS + (TRANSIENT_READINGS if record["stable"] else ())
    for name in names:
        if record[name] is not None:
            yield name, float(f"{record[name]:.{DIGITS}g}")
