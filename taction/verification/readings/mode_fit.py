"""Ringing in a transient: the frequency and growth rate of each mode.

`fit_modes` fits the poles that all channels share, then each pole's amplitude in each channel. A
saturated stretch has no poles: only the record before that stretch is fitted. The poles are those
of a matrix pencil in its subspace form (ESPRIT: Hua and Sarkar, IEEE Trans. ASSP 38, 814, 1990; Roy
and Kailath, IEEE Trans. ASSP 37, 984, 1989). All channels share one Hankel matrix, so all
contribute to the same poles; its singular values give the number of poles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.verification.readings.envelope import (
    Envelope,
    envelope,
    mixed,
    saturates,
    slows,
    spectrum,
)
from taction.verification.readings.signals import resample, typical_step

GONE = 1e-3  # magnitude of a pole that decays within one sample
_MOST_LENGTH = 80  # samples in a window
_MOST_STATES = 24  # real states
_EXTRA_STATES = 8  # states beyond the order in a step of subspace iteration
_LEAST_DENOMINATOR = 1e-4  # below, the normal equations lose too many digits


def _lags(samples: Floats, length: int) -> Floats:
    """Return products of samples (n, K) with samples 0 to length - 1 later, (n, length)."""
    padded = np.concatenate([samples, np.zeros((length - 1, samples.shape[1]))])
    later = np.lib.stride_tricks.sliding_window_view(padded, length, axis=0)
    return np.asarray(np.matmul(samples[:, None, :], later)[:, 0])


def _grams(samples: Floats, length: int) -> tuple[Floats, ...]:
    """Return Hankel Gram matrices of samples (n, K): of all, of the last and first 3/4."""
    # An element is its upper left neighbour minus the product that leaves the window, plus the
    # product that enters.
    n, quarter = samples.shape[0], samples.shape[0] // 4
    lags = _lags(samples, length)
    row = np.arange(length)
    place = np.minimum(row[:, None], row) * length + np.abs(row[:, None] - row)
    grams = []
    for begin, end in ((0, n), (quarter, n), (0, n - quarter)):
        beyond = end - length + 1
        upper = np.empty((length, length))  # element j of row i is (i, i + j)
        np.sum(lags[begin:beyond], axis=0, out=upper[0])
        np.subtract(lags[beyond:end], lags[begin : begin + length - 1], out=upper[1:])
        grams.append(np.cumsum(upper, axis=0).take(place))
    return tuple(grams)


def _order(energy: Floats) -> int:
    """Return the number of real states: of eigenvalues (rising) of the Gram matrix above noise."""
    length = energy.size
    size: list[float] = np.sqrt(np.maximum(energy, 0.0)).tolist()
    noise = float(np.median(size[: (length + 1) // 2]))
    floor = max(10 * noise, 1e-7 * size[-1])
    return min(max(sum(s > floor for s in size), 1), _MOST_STATES, length // 3)


def _poles(basis: Floats) -> Complexes:
    """Return the poles z of a signal subspace, orthonormal columns (length, order).

    Poles closer to 0 than `GONE`, or beyond its inverse, are set to that limit.
    """
    # Least squares for the shift by one sample, from all rows except the last row r: their Gram
    # matrix is ``1 - r r'``, its inverse ``1 + r r' / (1 - r'r)``. For a jump at the end of the
    # samples the denominator vanishes; backwards in time the jump is a pole that decays at once.
    upper, lower, last = basis[:-1], basis[1:], basis[-1]
    denominator = 1 - float(last @ last)
    backwards = denominator < _LEAST_DENOMINATOR
    if backwards:
        shift = np.asarray(np.linalg.lstsq(lower, upper, rcond=None)[0], dtype=np.float64)
    else:
        shift = upper.T @ lower
        shift += np.outer(last / denominator, last @ shift)
    z = np.linalg.eigvals(shift).astype(np.complex128)
    z[np.abs(z) < GONE] = GONE
    return 1 / z if backwards else z


def fit_poles(samples: Floats) -> tuple[Complexes, Complexes]:
    """Return the poles z of uniformly sampled channels (n, K), and how far each pole moves.

    The movement is the change of log z, real and imaginary part, between a fit to all samples and
    fits to the first and to the last three quarters. One step of subspace iteration, in a block
    that is wider by some states, gives the subspaces of the parts.
    """
    length = min(samples.shape[0] // 3, _MOST_LENGTH)
    whole, *parts = _grams(samples, length)
    energy, vectors = np.linalg.eigh(whole)
    order = _order(energy)
    z = _poles(vectors[:, length - order :])
    moved = np.zeros(z.size, dtype=np.complex128)
    block = vectors[:, max(length - order - _EXTRA_STATES, 0) :]
    for gram in parts:
        base = np.linalg.qr(gram @ block)[0]
        turn = np.linalg.eigh(base.T @ gram @ base)[1]
        other = _poles(base @ turn[:, -order:])
        ratio = np.log(other[np.argmin(np.abs(z[:, None] - other), axis=1)] / z)
        moved.real = np.maximum(moved.real, np.abs(ratio.real))
        moved.imag = np.maximum(moved.imag, np.abs(ratio.imag))
    return z, moved


RESOLVED = 1e-6  # nepers over the fitted stretch: a change below is rounding, of either sign
_FIT_SPAN = 16384  # raw points considered before the end of the stretch
_FIT_SAMPLES = 300  # uniform samples in one fit
_SAMPLES_PER_PERIOD = 6.0
_FEWEST_PERIODS = 8.0
_SPECTRUM = 4096  # samples in the spectrum that gives the fastest line
_COMPONENTS = 6  # principal components of the channels
_LINEAR_FRACTION = 0.25  # of a limit cycle's amplitude: below, the growth is still exponential
GOOD_FIT = 0.1  # unexplained part below which the growth rate of a fit is used
_REAL = 1e-9  # radians a sample: below, a pole does not oscillate
_FAINT = 1e-4  # of the strongest mode: below, a pole is an artefact of the fit
_MOST_GROWTH = 37.0  # nepers, 1e16: more growth within the stretch is a kink, not a mode
_FADED = 0.01  # of the largest envelope: below, a decayed ringing is not fitted


@dataclass(frozen=True, slots=True)
class Mode:
    """One exponential ``exp(growth_rate t) cos(2 pi frequency t + phase)`` shared by all channels.

    Attributes
    ----------
    frequency : float
        Hz; 0 for a mode that does not oscillate.
    growth_rate : float
        1/s; negative when it decays.
    amplitude : float
        Largest amplitude of a channel at `stop`, in the signals' unit.
    frequency_sigma, growth_sigma : float
        Standard uncertainties, Hz and 1/s: the larger of the uncertainty from the residual and of
        the difference between fits to the first and the last three quarters of the stretch.
    residual : float
        Part of the signals' variation that the whole fit leaves unexplained, 0 to 1.
    channels : tuple of float
        Amplitude in each channel at `stop`.
    start, stop : float
        The stretch that was fitted, s.
    doubt : str
        Why the fit is uncertain; empty for a reliable fit.
    """

    frequency: float
    growth_rate: float
    amplitude: float
    frequency_sigma: float
    growth_sigma: float
    residual: float
    channels: tuple[float, ...]
    start: float
    stop: float
    doubt: str

    @property
    def decays(self) -> bool:
        """Whether it decays beyond doubt (two standard uncertainties, and rounding)."""
        return self.growth_rate < -self._doubtful

    @property
    def grows(self) -> bool:
        """Whether it grows beyond doubt (two standard uncertainties, and rounding)."""
        return self.growth_rate > self._doubtful

    @property
    def _doubtful(self) -> float:
        length = self.stop - self.start  # 0 of a mode that is known, not fitted
        return 2 * self.growth_sigma + (RESOLVED / length if length else 0.0)


def _stretch(time: Floats, env: Envelope) -> tuple[int, str]:
    """Return the number of points from the start to use, and a doubt about the choice."""
    total = env.amplitude.max(axis=1)
    if env.period is None or total.size < 8:
        return time.size, ""
    if saturates(total):
        end = total[-max(total.size // 5, 2) :].mean()
        first = int(np.argmax(total > _LINEAR_FRACTION * end))
        doubt = "" if first >= 2 else "no stretch before saturation is long enough"
        keep = max(first, 2)
    elif total[-1] > 2 * total.min():
        keep, doubt = slows(total), ""
        if not keep:
            return time.size, ""
    else:
        keep, doubt = int(np.flatnonzero(total >= _FADED * total.max())[-1]) + 1, ""
    half = 0.5 * (env.time[1] - env.time[0])
    return max(int(np.searchsorted(time, env.time[keep - 1] + half)), 8), doubt


def _uniform(time: Floats, signals: Floats, period: float | None) -> tuple[float, Floats]:
    """Return step h (s) and samples (n, K) on a uniform grid that ends with the record.

    The step resolves the fastest line of the spectrum, but the harmonics of a clipped wave must
    not shorten the stretch to less than eight dominant periods.
    """
    time, signals = time[-_FIT_SPAN:], signals[-_FIT_SPAN:]
    last, span, typical = time.size - 1, float(time[-1] - time[0]), typical_step(time)
    coarse = typical * max(np.ceil(span / typical / _SPECTRUM), 1.0)
    _, one = resample(time, mixed(signals)[:, None], coarse, typical, last, _SPECTRUM, 2)
    power = np.abs(spectrum(one[:, 0]))
    most, middle = float(power.max()), power.size // 2
    floor = min(max(0.01 * most, 8 * float(np.partition(power, middle)[middle])), most)
    fastest = int(np.flatnonzero(power >= floor)[-1])
    longest = 2 * (power.size - 1) * coarse / (_SAMPLES_PER_PERIOD * max(fastest, 1))
    if period is not None:
        longest = max(longest, _FEWEST_PERIODS * period / _FIT_SAMPLES)
    longest = min(longest, span / (_FIT_SAMPLES - 1))
    step = typical * max(round(longest / typical), 1)
    return step, resample(time, signals, step, typical, last, _FIT_SAMPLES, 6)[1]


def _doubts(periods: float, residual: float, growth: float, sigma: float) -> str:
    """Say why a mode's fit is unsure, or nothing; growth and sigma over the fitted stretch."""
    tests = (
        (periods < 2, f"only {periods:.1f} periods in the fitted stretch"),
        (residual > GOOD_FIT, f"the fit leaves {residual:.0%} unexplained"),
        (abs(growth) < 2 * sigma + RESOLVED, "the sign of the growth rate is not established"),
    )
    return "; ".join(text for true, text in tests if true)


def fit_modes(
    time: Floats, signals: Floats, *, ringing: Envelope | None = None
) -> tuple[Mode, ...]:
    """Fit the modes of a transient, strongest first.

    The fitted stretch ends at a quarter of the amplitude at which the ringing saturates or its
    growth slows, or where the ringing has decayed to 1 % of its largest amplitude, or with the
    record. The stretch holds at most 300 uniform samples, about fifty periods of the fastest mode:
    a mode sixty times slower is not resolved.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s; need not be uniform.
    signals : ndarray (P, K)
        Finite; one unit for all channels.
    ringing : Envelope, optional
        `envelope` of the same signals, if the caller has it already.

    Returns
    -------
    tuple of Mode
        Empty for a record of fewer than 32 points and for constant signals.
    """
    if time.size < 32:
        return ()
    ringing = ringing or envelope(time, signals)
    used, doubt = _stretch(time, ringing)
    if used < 32:
        return ()
    step, samples = _uniform(time[:used], signals[:used], ringing.period)
    size = float(np.linalg.norm(samples))
    samples = samples - samples.mean(axis=0)
    if float(np.linalg.norm(samples)) <= 1e-14 * size or samples.shape[0] < 24:
        return ()
    _, strength, axes = np.linalg.svd(samples, full_matrices=False)
    main = axes[: max(np.count_nonzero(strength[:_COMPONENTS] > 1e-7 * strength[0]), 1)]
    z, moved = fit_poles(samples @ main.T)
    kept = np.abs(z) > GONE
    if not kept.any():
        return ()
    stop = float(time[used - 1])
    return _modes(samples, z[kept], moved[kept], step, stop, doubt)


def _exponentials(angle: Complexes, n: int) -> Complexes:
    """Return ``exp(angle k)``, (n, m); k is 0, and the value 1, where the magnitude is largest."""
    width = math.isqrt(n - 1) + 1
    k = np.arange(0.0, width)[:, None]
    coarse = np.exp(angle * (width * k - np.where(angle.real < 0, 0.0, n - 1.0)))
    return (coarse[:, None] * np.exp(angle * k)).reshape(-1, angle.size)[:n]


def _amplitudes(samples: Floats, angle: Complexes) -> tuple[Floats, Floats, Floats]:
    """Fit the amplitudes of poles' log z (m,) in one half plane to samples (n, K).

    Return the squared magnitude of each exponential (n, m), at most 1; the amplitudes (m, K) at
    magnitude 1; and the residuals (n, K).
    """
    columns = _exponentials(angle, samples.shape[0])
    rings = angle.imag > _REAL
    basis = np.concatenate([columns.real, columns.imag[:, rings]], axis=1)
    weights = np.linalg.lstsq(basis, samples, rcond=None)[0]
    sizes = np.abs(weights[: angle.size])
    sizes[rings] = np.hypot(sizes[rings], weights[angle.size :])
    return columns.real**2 + columns.imag**2, sizes, samples - basis @ weights


def _modes(
    samples: Floats, z: Complexes, moved: Complexes, step: float, stop: float, doubt: str
) -> tuple[Mode, ...]:
    """Return each pole's mode with amplitude, uncertainty and doubt, without modes in the noise."""
    n, channels = samples.shape
    states, upper = z.size, z.imag >= 0
    angle, moved = np.log(z[upper]), moved[upper] / step
    poles = angle / step
    back, length = step * np.arange(1.0 - n, 1.0), step * (n - 1)
    power, sizes, rest = _amplitudes(samples, angle)
    left = float(np.linalg.norm(rest))
    residual = left / float(np.linalg.norm(samples))
    noise = left / max(n * channels - 2 * states, 1) ** 0.5
    energy, strength = power.sum(axis=0), np.linalg.norm(sizes, axis=1)
    rms = np.sqrt(energy / n) * strength
    around = back[:, None] - back @ power / energy
    sigma = 2.0**0.5 * noise / (np.sqrt((power * around**2).sum(axis=0)) * strength)
    growth_sigma, turn_sigma = np.maximum(moved.real, sigma), np.maximum(moved.imag, sigma)
    rings = angle.imag > _REAL
    frequency = np.where(rings, poles.imag, 0.0) / (2 * np.pi)
    still = ~rings & (np.abs(angle.real) * n < 0.1)
    aliased = angle.imag > 0.98 * np.pi
    sound = ~still & ~aliased & (angle.real * n < _MOST_GROWTH)
    least = max(3 * noise, _FAINT * float(rms.max(where=sound, initial=0.0)))
    kept = np.flatnonzero(sound & (rms > least))
    at_stop = sizes * np.exp(np.minimum(poles.real, 0.0) * length)[:, None]
    found = []
    for i in kept[np.argsort(-rms[kept], kind="stable")].tolist():
        growth, its_sigma = float(poles[i].real), float(growth_sigma[i])
        periods = float(frequency[i]) * length if rings[i] else np.inf
        own = _doubts(periods, residual, growth * length, its_sigma * length)
        shares = tuple(at_stop[i].tolist())
        found.append(
            Mode(
                frequency=float(frequency[i]),
                growth_rate=growth,
                amplitude=max(shares),
                frequency_sigma=float(turn_sigma[i]) / (2 * np.pi),
                growth_sigma=its_sigma,
                residual=residual,
                channels=shares,
                start=stop - length,
                stop=stop,
                doubt="; ".join(filter(None, (doubt, own))),
            )
        )
    return tuple(found)
