"""What the checks of a design say by far, from its equilibrium and its modes alone.

A search for changes asks for hundreds of designs, and most of them fail by far. Such a design needs
no verdict: its modes without bounds, on some hundred instants, show that it fails. Where nothing
fails by far, a verdict decides. So no design is ever accepted by what stands here.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Complexes, Floats
from taction.system.reading_definitions import READINGS, RISE_LEVELS
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.stability.poles import Poles, summarise
from taction.verification.verdict.checks import Check, Outcome

FAR = 1.15  # times a limit: beyond it a design fails by far
CLOSE = 1.01  # times a limit of a rise time, which instants of its own resolve
LATER = 1.02  # times the limit: so far from its begin a rise is followed
FINE = 0.05  # angle of the fastest ringing between two of them: a rise errs by some 1e-3
FEWEST, MOST = 33, 4000  # of them
POINTS = 400  # instants, in geometric progression
EARLY, LATE = 0.03, 12.0  # of the fastest, and of the slowest time constant: first and last instant
ESTIMATED = "estimated from the modes"
PEAK = 0.02  # of the channel's step: a peak so far below a level may reach it between two instants
RESOLVED = 0.7  # angle of the fastest ringing between two instants up to which a rise is seen
SMALL = 1e-3  # of the step: smaller modes hide no rise
FAINT = 1e-6  # of the step: the outputs are those of larger modes
ROUNDED = 1e-11  # times the fastest pole: farther from the axis the sign of a pole is known
DEFECTIVE = 1e4  # step amplitudes: a larger mode has no direction of its own


@dataclass(frozen=True, eq=False)
class Outline:
    """A linear board's step response, without bounds: ``final + Re sum share exp(poles t)``, V."""

    poles: Complexes
    share: Complexes  # (n, N)
    final: Floats  # (N,)

    @classmethod
    def of(cls, board: LinearBoard, scene: Scene) -> Outline | None:
        """Return the outline of a board; None where its modes do not show it."""
        if not is_exact(board):
            return None
        space, outputs = board.state_space, board.circuit.outputs
        signs = np.array([out.sign for out in outputs])
        C = signs[:, None] * space.rows([out.node for out in outputs])[0]
        rest = board.equilibrium
        x = space.state_of(initial_unknowns(board, scene.analysis.initial))
        x = x - space.state_of(rest.values)
        halves = None if space.halves is None else space.halves[1]
        rows, parts = (
            ((C,), (x,))
            if halves is None
            else (
                halves.split_rows(C),
                halves.split_vectors(x),
            )
        )
        poles, shares = [], []
        for block, row, part in zip(space.blocks, rows, parts, strict=True):
            values, vectors = np.linalg.eig(block.A)
            try:
                weights = np.linalg.solve(vectors, part.astype(np.complex128))
            except np.linalg.LinAlgError:
                return None
            poles.append(values)
            shares.append(weights[:, None] * (row @ vectors).T)
        final = signs * [rest[out.node] for out in outputs]
        found = cls(np.concatenate(poles), np.concatenate(shares), final)
        largest, step = np.abs(found.share).max(initial=0.0), np.abs(C @ x).max(initial=0.0)
        return found if largest <= DEFECTIVE * step else None

    @property
    def resolution(self) -> float:
        """Distance from the imaginary axis beyond which the side of a pole is known, 1/s."""
        return ROUNDED * float(np.abs(self.poles).max(initial=0.0))

    def unstable(self) -> Poles | None:
        """Return the poles if the board is unstable beyond any doubt."""
        errors = np.full(len(self.poles), self.resolution)
        found = summarise(self.poles, complete=True, errors=errors)
        return found if found.known_unstable else None

    def fastest(self, time: float, level: float) -> float:
        """Return the largest angular frequency of ringing above `level`, V, at an instant, 1/s."""
        size = np.abs(self.share).max(axis=1, initial=0.0) * np.exp(self.poles.real * time)
        return float(np.abs(self.poles.imag[size > level]).max(initial=0.0))

    @functools.cached_property
    def _seen(self) -> tuple[Complexes, Complexes, Floats, Floats]:
        """Poles and shares of the modes that are not `FAINT`: one of each pair, then real ones."""
        step = float(np.abs(self.share.sum(axis=0)).max(initial=0.0))
        large = np.abs(self.share).max(axis=1, initial=0.0) > FAINT * step
        real, upper = large & (self.poles.imag == 0.0), large & (self.poles.imag > 0.0)
        ringing = self.poles[upper], 2.0 * self.share[upper]
        return *ringing, self.poles.real[real], self.share.real[real]

    def at(self, times: Floats, channels: int | slice = slice(None)) -> Floats:
        """Return the outputs, or some of them, at `times` (P,), V, (P, N)."""
        poles, share, rates, still = self._seen
        share, still = share[:, channels], still[:, channels]
        size, angle = np.exp(np.outer(times, poles.real)), np.outer(times, poles.imag)
        turning = (size * np.cos(angle)) @ share.real - (size * np.sin(angle)) @ share.imag
        return np.asarray(self.final[channels] + np.exp(np.outer(times, rates)) @ still + turning)


def can_estimate(scene: Scene, failed: Iterable[str]) -> bool:
    """Whether an estimate has every failed check of a scene."""
    known = {"steady_state", *READINGS}
    return set(failed) <= (known | {"stability"} if scene.checks.stability.margin <= 1.0 else known)


def estimated_checks(outline: Outline, scene: Scene, ideal: IdealAnswer) -> tuple[Check, ...]:
    """Return the checks of a stable board that fails one of them by far; empty for any other.

    A check that neither fails nor passes by far is inconclusive.
    """
    amplitude = float(np.abs(ideal.target - ideal.start).max(initial=0.0))
    rates = -outline.poles.real
    if ideal.problem or not amplitude or not rates.min(initial=math.inf) > outline.resolution:
        return ()
    first = EARLY / float(np.abs(outline.poles).max())
    times = np.append(0.0, np.geomspace(first, LATE / float(rates.min()), POINTS))
    found = tuple(_checks(outline, scene, ideal, amplitude, times))
    return found if any(check.outcome is Outcome.FAIL for check in found) else ()


def _checks(
    outline: Outline, scene: Scene, ideal: IdealAnswer, amplitude: float, times: Floats
) -> Iterator[Check]:
    checks, u, step = scene.checks, outline.at(times), ideal.target - ideal.start
    static = float(np.abs(outline.final - ideal.target).max()) / amplitude
    yield _check("steady_state", static, checks.steady_state.tolerance)
    if checks.stability.margin <= 1.0:
        yield _check("stability", float(outline.poles.real.max()), 0.0)
    limited, band = checks.settling_time, checks.settling_time.band
    outside = np.flatnonzero((np.abs(u - ideal.target) > band * amplitude).any(axis=1))
    last = float(times[outside[-1]]) if outside.size else 0.0
    known = limited.max is not None and limited.min is None
    settled = (last if static < band else math.inf) if known else None
    yield _check("settling_time", settled, limited.max)
    for name, beyond in (
        ("overshoot", (u - ideal.target) * np.sign(step)),
        ("undershoot", (ideal.start - u) * np.sign(step)),
    ):
        limits = getattr(checks, name)
        if limits is not None:
            yield _check(name, float(beyond.max(initial=0.0)) / amplitude, limits.max)
    if checks.rise_time is not None:
        channel = (checks.rise_time.channel or (len(step) + 1) // 2) - 1
        if channel < len(step) and step[channel]:
            progress = Progress(float(ideal.start[channel]), float(step[channel]), amplitude)
            seen, limits = progress(u[:, channel]), checks.rise_time
            rise = _rise(outline, channel, progress, times, seen, limits.max)
            yield _check("rise_time", rise, limits.max, limits.min, far=CLOSE)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a channel is on its way: 0 at `start`, V, 1 after its own `step`, V.

    `size` is the step amplitude of the network, V.
    """

    start: float
    step: float
    size: float

    def __call__(self, u: Floats) -> Floats:
        """Return the progress at voltages, V."""
        return (u - self.start) / self.step


def _rise(
    outline: Outline,
    channel: int,
    progress: Progress,
    times: Floats,
    seen: Floats,
    most: float | None,
) -> float | None:
    """Return the rise time, s, of a channel whose progress at `times` is `seen`.

    None where the instants may miss a peak that begins or ends it; infinite where it is longer than
    `LATER` times the limit `most`, s.

    The crossings lie between the instants around the first of them and around the last one, and are
    found on instants that resolve the ringing there.
    """
    first, last = (int(np.argmax(seen >= level)) for level in RISE_LEVELS)
    if not first or not last:
        return None
    begin, end = float(times[first - 1]), float(times[last])
    if most is not None:
        end = min(end, float(times[first]) + LATER * most)
    speed = outline.fastest(begin, SMALL * progress.size)
    count = math.ceil((end - begin) * speed / FINE) + FEWEST
    if count > MOST or speed * (float(times[first]) - begin) > RESOLVED:
        return None
    fine = np.linspace(begin, end, count)
    seen = progress(outline.at(fine, channel))
    low, high = (int(np.argmax(seen >= level)) for level in RISE_LEVELS)
    until = high or count - 1
    before, here, after = seen[: until - 1], seen[1:until], seen[2 : until + 1]
    peaks = here[(here > before) & (here >= after)]
    if not low or float(peaks.max(initial=-math.inf)) > RISE_LEVELS[1] - PEAK:
        return None
    if not high:
        return math.inf
    start, stop = (
        np.interp(level, seen[k - 1 : k + 1], fine[k - 1 : k + 1])
        for level, k in zip(RISE_LEVELS, (low, high), strict=True)
    )
    return float(stop - start)


def _check(
    name: str,
    value: float | None,
    most: float | None,
    least: float | None = None,
    *,
    far: float = FAR,
) -> Check:
    outcome, high, low = (
        Outcome.INCONCLUSIVE,
        math.inf if most is None else most,
        least or -math.inf,
    )
    if value is not None:
        margin = far if value > 0.0 else 1.0 / far
        if value > margin * high or margin * value < low:
            outcome = Outcome.FAIL
        elif margin * value <= high and value >= margin * low:
            outcome = Outcome.PASS
    known = value if value is not None and math.isfinite(value) else None
    return Check(name, outcome, known, None, most, None, "", ESTIMATED)
