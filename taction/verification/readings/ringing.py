"""The ringing of a record: its frequency, its amplitude over time, and whether it grows or decays.

The strongest line of the spectrum gives the frequency. Windows of two periods show the amplitude
over time: in each, a cubic (the trend) and a tone are fitted by least squares; what they leave
counts to the amplitude, so that no other ringing is lost. The logarithm of the tones' complex
amplitudes is a straight line in time; its slopes are the growth rate and what the frequency lacks.
A saturated stretch has no growth rate: only the record before that stretch is fitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.verification.readings.record import lagrange

RESOLVED = 1e-6  # nepers over the fitted stretch: a change below is rounding, of either sign
GOOD_FIT = 0.1  # unexplained part below which the growth rate of a fit is used
_SAMPLES = 8192  # of the spectrum
_WINDOWS, _INSTANTS = 64, 48  # most windows of a record; instants of each
_TREND = 4  # powers of the time in a window beside the ringing
_FEWEST_LINES = 3  # periods in the record of a ringing
_STRONG = 0.6  # of the largest line: the lowest such line may be the ringing
_WEAK = 0.1  # of a strong line: a weaker line at a third of its frequency is no fundamental
_ROUNDS = 6  # of the fit; each takes the growth and the frequency of the one before
_FADED = 0.01  # of the largest amplitude: below, a decayed ringing is not fitted
_LINEAR_FRACTION = 0.25  # of a limit cycle's amplitude: below, the growth is still exponential
_FITTED_WINDOWS = 16  # least number of windows of a fit
_MIXED = 4  # most modes of nearly one frequency
_GONE = 1e-3  # magnitude of an exponential that decays within one window
_SEEN = 0.02  # of the largest: a mode of a smaller share at the end is not told apart
_NEAR, _FAR = 0.1, 0.5  # relative distances of the fitted frequency from its line
_MOST = 0.5  # of a channel's ringing: a mode of a smaller share says nothing of the channel
_FEWEST_WINDOWS = 4  # of a fit
_ROUNDING = 1e-14  # of the largest signal: a smaller tone is none
_FAINT_REST = 1e-9  # of the largest tone: what a window leaves is at least rounding


@dataclass(frozen=True, slots=True)
class Mode:
    """One ringing ``exp(growth_rate t) cos(2 pi frequency t + phase)`` of all channels."""

    frequency: float  # Hz; 0 for a growth or decay without ringing
    growth_rate: float  # 1/s; negative when it decays
    channels: tuple[float, ...]  # amplitude in each channel at `stop`, in the signals' unit
    # Standard uncertainty of the growth rate, 1/s: from the scatter of the amplitudes, or from the
    # difference between fits to the first and to the last three quarters if larger.
    growth_sigma: float = 0.0
    residual: float = 0.0  # part of the ringing that the fit leaves unexplained, 0 to 1
    # `start`, `stop`: the stretch that was fitted, s; both 0 of a mode that is known, not fitted.
    start: float = 0.0
    stop: float = 0.0
    doubt: str = ""  # why the fit is uncertain; empty for a reliable fit

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
        length = self.stop - self.start
        return 2.0 * self.growth_sigma + (RESOLVED / length if length else 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class RecordRinging:
    """Ringing amplitude over time, and the mode that was fitted to it, of channels or of one."""

    time: Floats  # middle of each window (M,), s
    amplitude: Floats  # in each window (M, K), or (M,) of one channel, in the signals' unit
    period: float | None  # s; None, and `amplitude` 0, if no ringing lasts three periods
    mode: Mode | None  # of one channel None where it is not most of the ringing there

    @classmethod
    def none(cls, time: Floats, channels: int) -> RecordRinging:
        """Return that of a record (P,) without ringing."""
        return cls(time[-1:], np.zeros((1, channels)), None, None)

    def of(self, n: int) -> RecordRinging:
        """Return the ringing of one channel."""
        amplitude, mode = self.amplitude[:, n], self.mode
        if mode is not None:
            at = min(mode.stop, float(self.time[-1]))
            its = mode.channels[n] * math.exp(mode.growth_rate * (at - mode.stop))
            if its < _MOST * float(np.interp(at, self.time, amplitude)):
                mode = None
        mode = mode and replace(mode, channels=mode.channels[n : n + 1])
        return RecordRinging(self.time, amplitude, self.period, mode)


@dataclass(frozen=True, slots=True, eq=False)
class _Windows:
    """Samples of a record in windows of equal width."""

    middle: Floats  # (M,), s
    away: Floats  # instants of a window from its middle (n,), s
    samples: Floats  # (M, n, K)

    @classmethod
    def of(cls, time: Floats, signals: Floats, width: float, apart: float, fewest: int) -> _Windows:
        """Return windows of a `width`, with middles `apart`, s, or closer: `fewest` or more."""
        span = float(time[-1] - time[0])
        count = min(max(int((span - width) / apart) + 1, fewest), _WINDOWS)
        width = min(width, 0.9 * span)
        begin = np.linspace(time[0], time[-1] - width, count)
        away = width * ((np.arange(_INSTANTS) + 0.5) / _INSTANTS - 0.5)
        at = (begin[:, None] + 0.5 * width + away).ravel()
        values = lagrange(time, signals, np.clip(at, time[0], time[-1]), 6)
        return cls(begin + 0.5 * width, away, values.reshape(count, _INSTANTS, -1))

    @property
    def width(self) -> float:
        """Width of a window, s."""
        return 2.0 * float(self.away[-1])

    def fit(self, pole: complex, trend: int) -> tuple[Complexes, Floats]:
        """Fit a trend of so many powers and ``exp(pole t)``, or a slope if the pole is 0.

        Returns the amplitudes in the middle of each window, and the amplitudes of what is left,
        (M, K) each.
        """
        x, reach = self.away, self.width
        tone = np.exp(pole * x)
        columns = [x**k / reach**k for k in range(trend)]
        columns += [tone.real, tone.imag] if pole else [x / reach]
        basis, weight = np.stack(columns, axis=1), np.cos(np.pi * x / reach)
        inverse = np.linalg.pinv(basis * weight[:, None]) * weight
        found = inverse @ self.samples
        rest = self.samples - basis @ found
        left = np.sqrt(2.0 * (weight**2 @ rest**2) / float(weight @ weight))
        last = found[:, trend:]
        tones = last[:, 0] - 1j * last[:, 1] if pole else last[:, 0]
        return np.asarray(tones, dtype=np.complex128), np.asarray(left)


def _fundamental(size: Floats, k: int) -> int:
    """Return the fundamental of which line k is an odd harmonic, or k.

    A clipped wave has odd harmonics. In a sum of channels with different signs or phases the
    fundamental may cancel more than its harmonics.
    """
    for odd in (9, 7, 5, 3):
        low = max(round(k / odd) - 1, _FEWEST_LINES)
        j = low + int(size[low : low + 3].argmax())
        if odd * low < k and size[j] >= max(_WEAK * size[k], size[j - 1], size[j + 1]):
            return j
    return k


def _period(y: Floats, step: float, most: int) -> float | None:
    """Return the period of the lowest strong peak among the first `most` lines, or None.

    The lines are those of the difference of y under a Hann window. The difference keeps a slow tail
    from hiding the ringing; a second difference would favour a square wave's harmonics over its
    fundamental. The logarithms of the magnitudes are nearly a parabola around a peak.
    """
    slope = np.diff(y)
    size = np.abs(np.fft.rfft(slope * np.hanning(slope.size + 2)[1:-1]))[:most]
    inner = size[1:-1]
    strong = (inner >= size[:-2]) & (inner >= size[2:]) & (inner > _STRONG * size.max())
    k = _fundamental(size, int(np.argmax(strong)) + 1)
    if k < _FEWEST_LINES or 2 * k >= size.size or max(size[k // 2], size[2 * k]) > 0.5 * size[k]:
        return None
    a, b, c = np.log(np.maximum(size[k - 1 : k + 2], 1e-300)).tolist()
    offset = 0.5 * (a - c) / min(a - 2.0 * b + c, -1e-3)
    return float((y.size - 1) * step / (k + min(max(offset, -1.0), 1.0)))


def _dominant_period(time: Floats, signals: Floats) -> float | None:
    """Return the period of the strongest line, of the last half or of the whole record."""
    points = min(max(time.size, 128), _SAMPLES)
    step = float(time[-1] - time[0]) / (points - 1)
    at = np.minimum(time[0] + step * np.arange(points), time[-1])
    few = 6 if time.size < _SAMPLES // 2 else 2  # the chord between few points would add ringing
    weights = np.cos(np.arange(1.0, signals.shape[1] + 1))  # no symmetry cancels a mode in the sum
    y = lagrange(time, (signals @ weights)[:, None], at, few)[:, 0]
    most = _SAMPLES // 4
    return _period(y[points // 2 :], step, most // 2) or _period(y, step, most)


def saturates(amplitude: Floats) -> bool:
    """Tell whether an amplitude (M,) grew at least threefold and then stopped growing.

    The last fifth varies by less than 5 per cent, or by less than 15 per cent if it varies only
    from window to window: with few points a period the peaks of a clipped wave are uncertain.
    """
    last = amplitude[-max(amplitude.size // 5, 2) :]
    if amplitude.size < 8 or last.min() <= 0:
        return False
    end, half = float(last.mean()), last.size // 2
    drift = abs(float(last[-half:].mean() - last[:half].mean()))
    jagged = float(np.abs(np.diff(last, 2)).mean()) if last.size > 4 else 0.0
    spread = min(0.05 * end + jagged, 0.15 * end)
    return bool(amplitude.min() < end / 3 and np.ptp(last) < spread and drift < 0.05 * end)


def slows(amplitude: Floats) -> int:
    """Return how many windows precede the last fourfold growth of (M,) amplitudes, if that slows.

    The growth slows if its rate in the last sixteenth is less than half of the rate just before
    the fourfold growth; 0 if it does not slow.
    """
    first = int(np.argmax(amplitude > _LINEAR_FRACTION * amplitude[-1]))
    if first < 2 or amplitude.min() <= 0:
        return 0
    growth = np.diff(np.log(amplitude))
    before = growth[max(2 * first - amplitude.size, 0) : first]
    late = growth[-max(amplitude.size // 16, 2) :]
    return first if late.mean() < 0.5 * before.mean() else 0


def _stretch(total: Floats) -> tuple[int, str]:
    """Return how many of the windows (M,) to fit, and a doubt about the choice."""
    if total.size < 8:
        return total.size, ""
    if saturates(total):
        end = total[-max(total.size // 5, 2) :].mean()
        first = int(np.argmax(total > _LINEAR_FRACTION * end))
        return max(first, 2), "" if first >= 2 else "no stretch before saturation is long enough"
    if total[-1] > 2 * total.min():
        return slows(total) or total.size, ""
    return int(np.flatnonzero(total >= _FADED * total.max())[-1]) + 1, ""


def find_ringing(time: Floats, signals: Floats) -> RecordRinging:
    """Find the strongest ringing of a record.

    The fitted stretch ends at a quarter of the amplitude at which the ringing saturates or its
    growth slows, or where the ringing has decayed to 1 % of its largest amplitude, or with the
    record.

    `time` (P,): strictly increasing, s; P at least 8.
    `signals` (P, K): finite; one unit for all channels.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 1001)
    >>> found = find_ringing(time, np.exp(-time)[:, None] * np.sin(200.0 * time)[:, None])
    >>> round(2.0 * np.pi * found.mode.frequency, 3), round(found.mode.growth_rate, 3)
    (200.0, -1.0)
    """
    period = _dominant_period(time, signals)
    if period is None:
        return RecordRinging.none(time, signals.shape[1])
    pole, width = 2j * np.pi / period, 2.0 * period
    whole = _Windows.of(time, signals, width, period, _FEWEST_WINDOWS)
    tones, rest = whole.fit(pole, _TREND)
    amplitude = np.abs(tones) + rest
    kept, doubt = _stretch(amplitude.max(axis=1))
    used = time.size
    if kept < len(amplitude):
        used = max(int(np.searchsorted(time, whole.middle[kept - 1] + period)), 8)
    windows = _Windows.of(time[:used], signals[:used], width, period, _FITTED_WINDOWS)
    mode = _fit(windows, pole, _TREND, doubt)
    if mode is not None and abs(mode.frequency * period - 1.0) > _FAR:
        mode = None  # the fit left its line: a trend, whose tone cannot be told from its trend
    if mode is not None and abs(mode.frequency * period - 1.0) < _NEAR:
        if mode.residual < GOOD_FIT:  # now exact for it
            tones, rest = whole.fit(complex(mode.growth_rate, math.tau * mode.frequency), _TREND)
            amplitude = np.abs(tones) + rest
        period = 1.0 / mode.frequency
    return RecordRinging(whole.middle, amplitude, period, mode)


def find_growth(time: Floats, signals: Floats) -> Mode | None:
    """Fit ``exp(growth_rate t)`` to a record that does not ring; parameters as `find_ringing`."""
    width = float(time[-1] - time[0]) / 8.0
    return _fit(_Windows.of(time, signals, width, width / 2.0, _FITTED_WINDOWS), 0j, 1, "")


def _fit(windows: _Windows, pole: complex, trend: int, doubt: str) -> Mode | None:
    """Fit one complex exponential to all windows, from a pole near it; None without a signal.

    Each round fits tones that grow as the last one found: then they are exact for one exponential.
    A window counts by how little its tone leaves, so the start of a step counts little. A
    mode of nearly the same frequency that decays less counts as an uncertainty of a decay.
    """
    t, rings = windows.middle - windows.middle.mean(), bool(pole.imag)
    if len(t) < _FEWEST_WINDOWS:
        return None
    for _ in range(_ROUNDS):
        tones, rest = windows.fit(pole if rings else 0j, trend)
        size = float(np.abs(tones).max())
        if not size > _ROUNDING * float(np.abs(windows.samples).max()):
            return None
        left = np.linalg.norm(rest, axis=1) + _FAINT_REST * size
        shape = np.linalg.svd(tones / left[:, None], full_matrices=False)[2][0]
        whole = tones @ shape.conj()
        left += np.linalg.norm(tones - np.outer(whole, shape), axis=1)
        weight = (np.abs(whole) / left) ** 2
        log = np.log(np.maximum(np.abs(whole), np.finfo(np.float64).tiny))
        growth, sigma, level = _line(t, log, weight)
        turn = _turn(t, whole * np.exp(-1j * pole.imag * t), weight) if rings else 0.0
        pole = complex(growth, pole.imag + turn)
    scatter = log - level - growth * t
    spread = float(np.sqrt(weight @ scatter**2 / weight.sum()))
    power = np.abs(whole) ** 2
    unexplained = math.sqrt(float(power.sum() / (power * (1.0 + weight)).sum()))
    residual = min(math.hypot(unexplained, spread), 1.0)
    start, stop = (float(windows.middle[k] + windows.away[k]) for k in (0, -1))
    last = np.abs(shape) * math.exp(level + growth * (stop - float(windows.middle.mean())))
    length = stop - start
    if growth < -2.0 * sigma:
        sigma = max([sigma, *(rate - growth for rate in _rates(tones, float(t[1] - t[0])))])
    periods = length * pole.imag / math.tau if rings else math.inf
    doubts = [doubt, _doubts(periods, residual, growth * length, sigma * length)]
    return Mode(
        frequency=pole.imag / math.tau,
        growth_rate=growth,
        channels=tuple(last.tolist()),
        growth_sigma=sigma,
        residual=residual,
        start=start,
        stop=stop,
        doubt="; ".join(filter(None, doubts)),
    )


def _rates(tones: Complexes, apart: float) -> Floats:
    """Return the growth rates of the modes in amplitudes (M, K) of windows, 1/s.

    The amplitudes are sums of exponentials, whatever the tone is: the shift by one window in the
    subspace of their Hankel matrix has these exponentials as eigenvalues (ESPRIT: Roy and Kailath,
    IEEE Trans. ASSP 37, 984, 1989).
    """
    size = len(tones) // 2
    hankel = np.lib.stride_tricks.sliding_window_view(tones, size, axis=0)
    left, strength, _ = np.linalg.svd(hankel.reshape(-1, size).T, full_matrices=False)
    noise = max(10.0 * float(np.median(strength)), 1e-5 * float(strength[0]))
    order = min(int(np.count_nonzero(strength > noise)), _MIXED, size - 1)
    base = left[:, : max(order, 1)]
    poles = np.linalg.eigvals(np.linalg.lstsq(base[:-1], base[1:], rcond=None)[0])
    poles = poles[np.abs(np.log(np.maximum(np.abs(poles), _GONE))) < -math.log(_GONE)]
    powers = poles ** np.arange(len(tones))[:, None]
    shares = np.abs(np.linalg.lstsq(powers, tones, rcond=None)[0]).max(axis=1, initial=0.0)
    last = shares * np.abs(powers[-1])
    rates = np.log(np.abs(poles)) / apart
    return np.asarray(rates[last > _SEEN * last.max(initial=0.0)])


def _doubts(periods: float, residual: float, growth: float, sigma: float) -> str:
    """Say why a mode's fit is unsure, or nothing; growth and sigma over the fitted stretch."""
    tests = (
        (periods < 2, f"only {periods:.1f} periods in the fitted stretch"),
        (residual > GOOD_FIT, f"the fit leaves {residual:.0%} unexplained"),
        (abs(growth) < 2 * sigma + RESOLVED, "the sign of the growth rate is not established"),
    )
    return "; ".join(text for true, text in tests if true)


def _line(t: Floats, y: Floats, weight: Floats) -> tuple[float, float, float]:
    """Return the slope of a line through points (M,), its standard uncertainty, and y at 0.

    One point has no slope: any one may be true.
    """
    if np.count_nonzero(weight) < 2:
        return 0.0, math.inf, float(y[weight.argmax()])

    def slope(some: slice) -> tuple[float, float, float]:
        x, w = t[some], weight[some] / weight[some].sum()
        away = x - w @ x
        found = float(w @ (away * y[some]) / (w @ away**2))
        level = float(w @ y[some] - found * (w @ x))
        scatter = float(w @ (y[some] - level - found * x) ** 2 / (w @ away**2))
        return found, math.sqrt(scatter / max(len(x) - 2, 1)), level

    quarter = len(t) // 4
    parts = [slope(each)[0] for each in (slice(quarter, None), slice(len(t) - quarter))
             if np.count_nonzero(weight[each]) > 1]  # fmt: skip
    found, sigma, level = slope(slice(None))
    return found, max(sigma, *(abs(part - found) for part in parts)), level


def _turn(t: Floats, whole: Complexes, weight: Floats) -> float:
    """Return by how much faster the phases of amplitudes (M,) turn, rad/s, without unwrapping."""
    both = np.sqrt(weight[1:] * weight[:-1])
    unit = whole / np.maximum(np.abs(whole), np.finfo(np.float64).tiny)
    first = float(np.angle(both @ (unit[1:] * unit[:-1].conj()))) / float(t[1] - t[0])
    unit = unit * np.exp(-1j * first * t)
    middle = weight @ unit
    return first + _line(t, np.angle(unit * np.conj(middle)), weight)[0]
