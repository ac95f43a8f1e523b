"""Ringing in a transient: its envelope, and the frequency and growth rate of each mode.

`fit_modes` is a matrix-pencil fit in its subspace form (ESPRIT; Hua and Sarkar, IEEE Trans. ASSP
38, 814, 1990; Roy and Kailath, IEEE Trans. ASSP 37, 984, 1989). The samples of all channels share
one Hankel matrix, so every channel bears on the same poles; its singular values give the number of
modes. A saturated stretch has no poles: only what comes before it is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verification.crossings import lagrange
from verification.envelope import Envelope, envelope, mixed, saturates, spectrum
from verification.waveforms import Floats

Complexes = NDArray[np.complex128]

_FIT_SPAN = 16384  # raw points considered before the end of the stretch
_FIT_SAMPLES = 300  # uniform samples in one fit
_SAMPLES_PER_PERIOD = 6.0
_FEWEST_PERIODS = 8.0
_COMPONENTS = 6  # principal components of the channels
_ORDER = 24  # most real states in one fit
_LINEAR_FRACTION = 0.25  # of a limit cycle's amplitude: below, the growth is still exponential
_FAINT = 1e-4  # of the strongest mode: below, a pole is an artefact of the fit
_FADED = 0.01  # of the largest envelope: below, a decayed ringing is not worth fitting


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
        Of the channel with the most, at `stop`, in the signals' unit.
    frequency_sigma, growth_sigma : float
        Standard uncertainties, Hz and 1/s: the larger of what the residual allows and of how far
        fits to the first and the last three quarters of the stretch differ.
    residual : float
        Part of the signals' variation that the whole fit leaves unexplained, 0 to 1.
    channels : tuple of float
        Amplitude in each channel at `stop`.
    start, stop : float
        The stretch that was fitted, s.
    doubt : str
        Empty when the fit is sure of itself, otherwise why it is not.
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
        """Whether it decays beyond doubt (two standard uncertainties)."""
        return self.growth_rate + 2 * self.growth_sigma < 0

    @property
    def grows(self) -> bool:
        """Whether it grows beyond doubt (two standard uncertainties)."""
        return self.growth_rate - 2 * self.growth_sigma > 0


def _stretch(time: Floats, env: Envelope) -> tuple[int, str]:
    """Return how many points from the start to use, and a doubt about the choice."""
    total = env.amplitude.max(axis=1)
    if env.period is None or total.size < 8:
        return time.size, ""
    if saturates(total):
        end = total[-max(total.size // 5, 2) :].mean()
        first = int(np.argmax(total > _LINEAR_FRACTION * end))
        doubt = "" if first >= 2 else "no stretch before saturation is long enough"
        keep = max(first, 2)
    elif total[-1] > 2 * total.min():
        return time.size, ""
    else:
        keep, doubt = int(np.flatnonzero(total >= _FADED * total.max())[-1]) + 1, ""
    half = 0.5 * (env.time[1] - env.time[0])
    return max(int(np.searchsorted(time, env.time[keep - 1] + half)), 8), doubt


def _uniform(time: Floats, signals: Floats, period: float | None) -> tuple[float, Floats]:
    """Return step h (s) and samples (n, K) on a uniform grid that ends with the record.

    The step resolves the fastest line of the spectrum, but a clipped wave's harmonics must not
    shorten the stretch to less than eight periods of the dominant one.
    """
    time, signals = time[-_FIT_SPAN:], signals[-_FIT_SPAN:]
    span = float(time[-1] - time[0])
    n = min(max(time.size, 64), 4096)
    grid = np.linspace(time[0], time[-1], n)
    power = spectrum(np.interp(grid, time, mixed(signals)))
    floor = max(0.01 * float(power.max()), 8 * float(np.median(power)))
    fastest = int(np.flatnonzero(power >= min(floor, float(power.max())))[-1])
    pace = float(np.median(np.diff(time)))
    wanted = span / (_SAMPLES_PER_PERIOD * max(fastest, 1))
    if period is not None:
        wanted = max(wanted, _FEWEST_PERIODS * period / _FIT_SAMPLES)
    wanted = min(wanted, span / (_FIT_SAMPLES - 1))
    if span / wanted > _FIT_SAMPLES:  # many periods: the last of them
        wanted = max(wanted, pace)
    step = pace * max(round(wanted / pace), 1)
    samples = min(int(span / step * (1 + 1e-9)) + 1, _FIT_SAMPLES)
    at = np.clip(time[-1] - step * np.arange(samples - 1, -1, -1), time[0], time[-1])
    return step, lagrange(time, signals, at, 6)


def _pencil(samples: Floats, order: int | None = None) -> Complexes:
    """Return the poles z of uniformly sampled channels (n, K); `order` from the singular values."""
    length = min(samples.shape[0] // 3, 80)
    hankel = np.lib.stride_tricks.sliding_window_view(samples, length, axis=0)
    rows = hankel.reshape(-1, length)
    energy, vectors = np.linalg.eigh(rows.T @ rows)
    size = np.sqrt(np.maximum(energy[::-1], 0.0))
    if order is None:
        floor = max(10 * float(np.median(size[length // 2 :])), 1e-7 * float(size[0]))
        order = int(np.clip(np.count_nonzero(size > floor), 1, min(_ORDER, length // 3)))
    basis = vectors[:, ::-1][:, :order]
    shift = np.linalg.lstsq(basis[:-1], basis[1:], rcond=None)[0]
    return np.asarray(np.linalg.eigvals(shift), dtype=np.complex128)


def _spread(samples: Floats, z: Complexes) -> Complexes:
    """Return how far each pole moves (real and imaginary part of log z) on parts of the stretch."""
    quarter = samples.shape[0] // 4
    moved = np.zeros(z.size, dtype=np.complex128)
    for part in (samples[quarter:], samples[: samples.shape[0] - quarter]):
        other = _pencil(part, z.size)
        ratio = np.log(other[np.argmin(np.abs(z[:, None] - other), axis=1)]) - np.log(z)
        moved = np.maximum(moved.real, abs(ratio.real)) + 1j * np.maximum(
            moved.imag, abs(ratio.imag)
        )
    return moved


def _doubts(periods: float, residual: float, growth: float, sigma: float) -> str:
    """Say why a mode's fit is unsure, or nothing."""
    tests = (
        (periods < 2, f"only {periods:.1f} periods in the fitted stretch"),
        (residual > 0.1, f"the fit leaves {residual:.0%} unexplained"),
        (abs(growth) < 2 * sigma, "the sign of the growth rate is not established"),
    )
    return "; ".join(text for true, text in tests if true)


def fit_modes(
    time: Floats, signals: Floats, *, ringing: Envelope | None = None
) -> tuple[Mode, ...]:
    """Fit the modes of a transient, strongest first.

    The stretch that is fitted ends where the ringing saturates, or has faded to 1 % of its
    largest, or with the record, and holds at most 300 uniform samples: some fifty periods of the
    fastest mode, so a mode sixty times slower than that is not resolved.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s; need not be uniform.
    signals : ndarray (P, K)
        Finite; one unit for all channels.
    ringing : Envelope, optional
        `envelope` of the same signals, to save computing it again.

    Returns
    -------
    tuple of Mode
        Empty when the record has fewer than 32 points or nothing but a constant.
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
    z = _pencil(samples @ main.T)
    z = z[np.abs(z) > 1e-3]
    if z.size == 0:
        return ()
    moved = _spread(samples @ main.T, z) / step
    stop = float(time[used - 1])
    return _modes(samples, z, moved, step, stop, doubt)


def _modes(
    samples: Floats, z: Complexes, moved: Complexes, step: float, stop: float, doubt: str
) -> tuple[Mode, ...]:
    """Give each pole its amplitude, uncertainty and doubt; drop those within the noise."""
    n, channels = samples.shape
    poles = np.log(z) / step
    back = step * np.arange(1 - n, 1)
    length = step * (n - 1)
    # Each exponential is 1 where it is largest: at the start if it decays, at the end if it grows.
    columns = np.exp(poles * (back[:, None] + np.where(poles.real < 0, length, 0.0)))
    weights = np.linalg.lstsq(columns, samples.astype(np.complex128), rcond=None)[0]
    left = float(np.linalg.norm(samples - (columns @ weights).real))
    residual = left / float(np.linalg.norm(samples))
    noise = left / np.sqrt(max(n * channels - 2 * z.size, 1))
    power = np.abs(columns) ** 2  # (n, order)
    pairs = np.where(poles.imag > 1e-9 / step, 2.0, 1.0)
    sizes = pairs[:, None] * np.abs(weights)  # (order, channels)
    rms = np.sqrt(power.mean(axis=0)) * np.linalg.norm(sizes, axis=1)
    least = max(3 * noise, _FAINT * float(rms.max()))
    still = (pairs == 1.0) & (np.abs(poles.real) * step * n < 0.1)
    aliased = poles.imag * step > 0.98 * np.pi
    kept = (poles.imag > -1e-9 / step) & ~still & ~aliased & (rms > least)
    found = []
    for i in sorted(np.flatnonzero(kept), key=lambda j: -rms[j]):
        spread = back - (power[:, i] @ back) / power[:, i].sum()
        leverage = np.sqrt(power[:, i] @ spread**2) * np.linalg.norm(sizes[i])
        sigma = float(np.sqrt(2.0) * noise / leverage)
        growth, growth_sigma = float(poles[i].real), max(float(moved[i].real), sigma)
        frequency = float(poles[i].imag) / (2 * np.pi) if pairs[i] == 2.0 else 0.0
        periods = frequency * length if frequency else np.inf
        own = _doubts(periods, residual, growth, growth_sigma)
        at_stop = sizes[i] * np.exp(min(growth, 0.0) * length)
        found.append(
            Mode(
                frequency=frequency,
                growth_rate=growth,
                amplitude=float(at_stop.max()),
                frequency_sigma=max(float(moved[i].imag), sigma) / (2 * np.pi),
                growth_sigma=growth_sigma,
                residual=residual,
                channels=tuple(at_stop.tolist()),
                start=stop - length,
                stop=stop,
                doubt="; ".join(filter(None, (doubt, own))),
            )
        )
    return tuple(found)
