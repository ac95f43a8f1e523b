"""A stable rational function from a simulated response: poles by AAA, residues by least squares.

AAA (Nakatsukasa, Sete, Trefethen 2018, `scipy.interpolate.AAA`) interpolates some points with a
small absolute error. Its poles in the left half plane are kept; the residues then follow from least
squares in which every point counts relative to its own magnitude. AAA sees every other point; the
error is the largest relative one at all points.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np

from spice_models.array_types import Complexes, Floats
from spice_models.imported import Rational

ENOUGH = 1e-6  # relative error at which no further pole is added
TERMS = range(2, 17)
REAL = 1e-9  # imaginary part, relative to the pole, that counts as rounding
SCALES = (1e-7, 1e2)  # of poles, relative to the highest angular frequency


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
    s = 2j * np.pi * frequencies
    best: tuple[Rational, float] | None = None
    for poles in _candidates(s[::2], response[::2]):
        rational = _residues(s, response, poles)
        error = float(np.max(np.abs(evaluate(rational, s) / response - 1.0)))
        if best is None or error < best[1]:
            best = rational, error
        if error <= ENOUGH:
            break
    assert best is not None  # the constant is a candidate
    return best


def evaluate(rational: Rational, s: Complexes) -> Complexes:
    """Return the values at `s`, (P,), 1/s."""
    value = np.full(s.shape, rational.constant, dtype=np.complex128)
    for pole, residue in zip(rational.poles, rational.residues, strict=True):
        value += residue / (s - pole)
        if pole.imag:
            value += residue.conjugate() / (s - pole.conjugate())
    return value


def _candidates(s: Complexes, response: Complexes) -> Iterator[Complexes]:
    """Yield sets of stable poles, one of each pair, from none to more and more."""
    from scipy.interpolate import AAA

    yield np.zeros(0, dtype=np.complex128)
    top = float(np.abs(s).max())
    z, values = np.concatenate([s, s.conj()]) / top, np.concatenate([response, response.conj()])
    for terms in TERMS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # fewer terms than it needs, as asked for
            poles = AAA(z, values, rtol=1e-13, max_terms=terms).poles()
        size = np.abs(poles)
        poles = poles[(poles.real < 0.0) & (size > SCALES[0] * 1e-7) & (size < SCALES[1])]
        real = np.abs(poles.imag) <= REAL * np.abs(poles)
        poles = np.where(real, poles.real, poles)
        yield top * poles[real | (poles.imag > 0.0)]


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
