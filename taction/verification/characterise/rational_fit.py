"""A stable rational function from a simulated response: poles by AAA, residues by least squares.

AAA (Nakatsukasa, Sete, Trefethen 2018, `scipy.interpolate.AAA`) interpolates some points with a
small absolute error; a gain of 1e8 would hide what it does at unity, so it is also fitted with a
zero above its first pole. Poles in the left half plane are kept; the residues then follow from
least squares in which every point counts relative to its own magnitude. AAA sees every other point;
the error is the largest relative one at all points.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from taction.spice_models.imported import Rational
from taction.system.array_types import Complexes, Floats

ENOUGH = 1e-6  # relative error at which no further pole is added
TERMS = range(2, 17)
FALLEN = 0.1  # of the response at the lowest frequency: there the zero is set
REAL = 1e-4  # imaginary part, relative to the pole, that counts as rounding
SAME = 1e-3  # relative difference of poles that are one
SCALES = (1e-14, 1e2)  # of poles, relative to the highest angular frequency


def has_aaa() -> bool:
    """Whether this SciPy has the algorithm."""
    from scipy import interpolate

    return hasattr(interpolate, "AAA")


def fit_together(
    frequencies: Floats, responses: Sequence[Complexes]
) -> tuple[list[Rational], list[float]]:
    """Return rational functions with the same poles, and their largest relative errors.

    The poles are those of each response by itself; poles closer than `SAME` are one.
    """
    poles: list[complex] = []
    for response in responses:
        poles = _distinct(fit_rational(frequencies, response)[0].poles, poles)
    s = _s(frequencies)
    found = [_residues(s, response, np.array(poles)) for response in responses]
    pairs = zip(found, responses, strict=True)
    return found, [_error(rational, s, response) for rational, response in pairs]


def fit_rational(frequencies: Floats, response: Complexes) -> tuple[Rational, float]:
    """Return the rational function with the fewest poles, and its largest relative error.

    Parameters
    ----------
    frequencies : ndarray (P,)
        Hz, above 0.
    response : ndarray (P,)
        Nowhere 0.

    Examples
    --------
    >>> f = np.logspace(0.0, 6.0, 121)
    >>> found, error = fit_rational(f, 100.0 / (1.0 + 1j * f / 1e3))
    >>> error < 1e-9, round(found.poles[0].real / (2.0 * np.pi), 6)
    (True, -1000.0)
    """
    s = _s(frequencies)
    constant = _residues(s, response, np.zeros(0, dtype=np.complex128))
    best = constant, _error(constant, s, response)
    low = np.flatnonzero(np.abs(response) < FALLEN * np.abs(response[0]))
    flat = response * (1.0 + s / np.abs(s[low[0]])) if low.size else response[:0]
    several = (_candidates(s[::2], each[::2]) for each in (response, flat) if each.size)
    for poles in chain.from_iterable(several):
        rational = _residues(s, response, poles)
        error = _error(rational, s, response)
        if error < best[1]:
            best = rational, error
        if best[1] <= ENOUGH:
            break
    return best


def _s(frequencies: Floats) -> Complexes:
    return np.asarray(2j * np.pi * frequencies, dtype=np.complex128)


def _error(rational: Rational, s: Complexes, response: Complexes) -> float:
    return float(np.max(np.abs(evaluate(rational, s) / response - 1.0)))


def evaluate(rational: Rational, s: Complexes) -> Complexes:
    """Return the values at `s`, (P,), 1/s."""
    value = np.full(s.shape, rational.constant, dtype=np.complex128)
    for pole, residue in zip(rational.poles, rational.residues, strict=True):
        value += residue / (s - pole)
        if pole.imag:
            value += residue.conjugate() / (s - pole.conjugate())
    return value


def _candidates(s: Complexes, response: Complexes) -> Iterator[Complexes]:
    """Yield sets of stable poles, one of each pair, more and more."""
    from scipy.interpolate import AAA

    top = float(np.abs(s).max())
    z, values = np.concatenate([s, s.conj()]) / top, np.concatenate([response, response.conj()])
    for terms in TERMS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # fewer terms than it needs, as asked for
            poles = AAA(z, values, rtol=1e-13, max_terms=terms).poles()
        size = np.abs(poles)
        poles = poles[(poles.real < 0.0) & (size > SCALES[0]) & (size < SCALES[1])]
        real = np.abs(poles.imag) <= REAL * np.abs(poles)
        upper = poles.real + 1j * np.where(real, 0.0, np.abs(poles.imag))
        yield np.array(_distinct((top * upper).tolist(), []), dtype=np.complex128)


def _distinct(poles: Iterable[complex], known: list[complex]) -> list[complex]:
    """Return `known` with those `poles` that differ from all others by more than `SAME`."""
    for pole in poles:
        if all(abs(pole - other) > SAME * abs(other) for other in known):
            known.append(pole)
    return known


def _residues(s: Complexes, response: Complexes, poles: Complexes) -> Rational:
    """Return the rational function of the given poles that fits best."""
    columns = [np.ones_like(s)]
    for pole in poles.tolist():
        forward = 1.0 / (s - pole)
        backward = 1.0 / (s - pole.conjugate())
        columns += [forward + backward, 1j * (forward - backward)] if pole.imag else [forward]
    matrix = np.stack(columns, axis=1) / response[:, None]
    matrix = np.concatenate([matrix.real, matrix.imag])
    wanted = np.concatenate([np.ones(len(s)), np.zeros(len(s))])
    scale = np.abs(matrix).max(axis=0)
    found = iter((np.linalg.lstsq(matrix / scale, wanted, rcond=None)[0] / scale).tolist())
    constant = next(found)
    residues = [complex(next(found), next(found) if pole.imag else 0.0) for pole in poles.tolist()]
    return Rational(constant, tuple(poles.tolist()), tuple(residues))
