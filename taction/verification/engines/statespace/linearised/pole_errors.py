"""Bounds on the errors of poles, from the couplings that the residual leaves between modes."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.block_modes import (
    BlockModes,
    balanced_sums,
    components,
)

LINKED = 16.0  # the square of a distance, over it: a larger coupling in both directions links
TIGHT = 0.9  # row sum of the couplings over distances, from which their series may not end
IRREDUCIBLE = 1e-18  # keeps the sizes of couplings irreducible
CIRCLE = 64  # points of a circle around a group


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def pole_errors(modes: BlockModes) -> Floats:
    """Bound the distance of every pole to its true pole, 1/s, (n,); infinite where unknown."""
    errors = _errors(modes)
    if modes.other is not None and len(errors):
        s, other = modes.poles, modes.other.poles
        there = np.abs(s[:, None] - other) + _errors(modes.other)
        errors = np.minimum(errors, there.min(axis=1))
    return errors


def _errors(modes: BlockModes) -> Floats:
    """Bound the errors of the poles of one set of vectors.

    Poles whose couplings may exchange them form components; a group is one. Beside a component, all
    others add a second order ``E (D - E)^-1 E``: D is half the distance of a pole, or the inverse
    of the largest resolvent on the circle around a group.
    """
    s, E, n = modes.poles, modes.coupling, len(modes.T)
    unknown = np.full(n, np.inf)
    if not (n and modes.is_known):
        return unknown
    centre, radius, stiffness = s.copy(), np.zeros(n), np.full(n, np.inf)
    seen = E.copy()
    for each in modes.groups:
        own = each.members
        T, beside = modes.T[np.ix_(own, own)], np.delete(s, own)
        centre[own], radius[own], stiffness[own] = _circle(T, E[np.ix_(own, own)], beside)
        seen[own] = np.linalg.norm(E[own], axis=0)
    gap = np.maximum(np.abs(centre[:, None] - centre) - radius[:, None] - radius, 0.0)
    own = np.diag(E)
    linked = (modes.group[:, None] == modes.group) | (gap**2 / LINKED < E * E.T)
    linked |= gap < 4.0 * (own[:, None] + own)
    for _ in range(n):
        label = components(linked)
        apart = label[:, None] != label
        half = np.where(apart, np.minimum(gap / 2.0, stiffness[:, None]), np.inf)
        nearest = half.min(axis=1, initial=np.inf)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            H = np.nan_to_num(seen / nearest[:, None], nan=np.inf, posinf=1e300)
        tight = ~(balanced_sums(H, s) < TIGHT)
        if not tight.any():
            beyond = (seen + seen @ np.linalg.solve(np.eye(n) - H, H)) / half
            errors = _within(E + E @ beyond, label, centre, radius)
            tight = (errors >= nearest) & (radius == 0.0)
            if not tight.any():
                return np.asarray(errors + np.abs(s - centre))
        more = linked | (tight[:, None] & (half <= 1.01 * nearest[:, None]))
        more |= more.T
        if np.array_equal(more, linked | linked.T):
            break
        linked = more
    return unknown


def _within(E: Floats, label: Ints, centre: Complexes, radius: Floats) -> Floats:
    """Bound the errors of the poles within each component: couplings E, circles around groups."""
    errors = np.diag(E).copy()
    numbers, counts = np.unique(label, return_counts=True)
    for number in numbers[counts > 1].tolist():
        own = np.flatnonzero(label == number)
        errors[own] = _set_errors(E[np.ix_(own, own)], centre[own], radius[own])
    return errors


def _set_errors(E: Floats, centre: Complexes, radius: Floats) -> Floats:
    """Bound the errors of one component.

    Every true pole is nearer than the spectral radius of all sizes to one member, and discs that
    overlap are one set.
    """
    if np.ptp(radius) == 0.0 and radius[0] > 0.0 and np.all(centre == centre[0]):
        return radius
    weak = IRREDUCIBLE * np.sqrt(np.outer(E.max(axis=1), E.max(axis=1)))
    disc = 1.01 * float(np.abs(np.linalg.eigvals(E + weak)).max()) + radius
    gap = np.abs(centre[:, None] - centre)
    joined = components(gap <= disc[:, None] + disc)
    return np.asarray(np.where(joined[:, None] == joined, gap + disc, 0.0).max(axis=1))


def _circle(T: Complexes, E: Floats, others: Complexes) -> tuple[complex, float, float]:
    """Return centre and radius of a circle around the true poles of a group, and its stiffness.

    On the circle ``|E (s - T)^-1| < 1/2``, so no pole crosses it. The stiffness is the inverse of
    the largest ``(s - T)^-1`` outside of a circle half-way to the nearest of the `others`.
    """
    s, size = np.diag(T), 2.0 * float(np.linalg.norm(E))
    centre, one = complex(s.mean()), np.eye(len(s))
    spread = float(np.abs(s - centre).max())
    turns = np.exp(2j * np.pi * np.arange(CIRCLE) / CIRCLE)[:, None, None] * one

    def largest(radius: float) -> float:
        inverse = np.linalg.inv(radius * turns - (T - centre * one))
        return 2.0 * float(np.linalg.norm(inverse, axis=(1, 2)).max())  # twice: between the points

    extra = max(size, 1e-3 * spread, 1e-15 * abs(centre))
    for _ in range(100):
        if size * largest(spread + extra) < 0.5:
            break
        extra *= 1.6
    radius = spread + extra
    distance = float(np.abs(others - centre).min(initial=np.inf))
    wide = (radius + distance) / 2.0 if np.isfinite(distance) else 2.0 * radius
    return centre, radius, 1.0 / largest(max(radius, wide))
