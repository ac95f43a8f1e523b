"""What the checks of a design say by far, from its equilibrium and its modes alone.

A search for changes asks for hundreds of designs, and most of them fail by far. Such a design needs
no verdict: its modes without bounds, on some hundred instants, show that it fails. Where nothing
fails by far, a verdict decides. So no design is ever accepted by what stands here.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from taction.netlist_gen.scene.checks import RiseTimeCheck
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.system.reading_definitions import READINGS, RISE_LEVELS, SMALL_STEP
from taction.verification.engines.statespace.equations.alike import of_one_kind
from taction.verification.engines.statespace.linearised.board import (
    Initial,
    LinearBoard,
    initial_unknowns,
    linearise_boards,
)
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.stability.poles import Poles, summarise
from taction.verification.verdict.checks import Check, Outcome

FAR = 1.15  # times a limit: beyond it a design fails by far
CLOSE = 1.01  # times a limit of the state at rest, which is solved, or of a rise time
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

    @property
    def resolution(self) -> float:
        """Distance from the imaginary axis beyond which the side of a pole is known, 1/s."""
        return ROUNDED * float(np.abs(self.poles).max(initial=0.0))

    def unstable(self) -> Poles | None:
        """Return the poles if the board is unstable beyond any doubt."""
        errors = np.full(len(self.poles), self.resolution)
        found = summarise(self.poles, complete=True, errors=errors)
        return found if found.known_unstable else None

    def ringing(self) -> float:
        """Return the angle by which the longest ringing turns in its time constant, rad."""
        rings = self.poles.imag > 0.0
        damping = np.maximum(np.abs(self.poles.real[rings]), self.resolution)
        return float((self.poles.imag[rings] / damping).max(initial=0.0))

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


def outlines(boards: Sequence[LinearBoard], initial: Initial) -> list[Outline | None]:
    """Return the outlines of boards, those of one structure found together.

    None for a board whose modes do not show the response, or that has none. Every outline has the
    digits that it has alone.

    Examples
    --------
    >>> import taction
    >>> from taction.netlist_gen.board.synthesis import synthesise
    >>> board = LinearBoard(synthesise(taction.load_scene("scenes/custom-matrix.toml")))
    >>> one, other = outlines([board, board], "zero")
    >>> one.final.tolist() == other.final.tolist() == one.at([1.0])[0].tolist()
    True
    """
    if len(boards) > 1:
        linearise_boards(boards)
    starts = [_BoardAtStart.of(board, initial) for board in boards]
    blocks = [block for start in starts if start is not None for block in start.blocks]
    modes = iter(_decomposed(blocks))
    return [
        None if start is None else start.outline([next(modes) for _ in start.blocks])
        for start in starts
    ]


def _decomposed(blocks: Sequence[_PartAtStart]) -> list[tuple[Complexes, Complexes | None]]:
    """Return eigenvalues and vectors of each block, of one that rests its eigenvalues alone."""
    found: dict[int, tuple[Complexes, Complexes | None]] = {}
    for places in of_one_kind({k: (len(b.A), b.rests) for k, b in enumerate(blocks)}):
        A = np.stack([blocks[k].A for k in places])
        if blocks[places[0]].rests:
            poles = np.linalg.eigvals(A).astype(np.complex128)
            found |= {k: (values, None) for k, values in zip(places, poles, strict=True)}
        else:
            modes = (each.astype(np.complex128) for each in np.linalg.eig(A))
            found |= zip(places, zip(*modes, strict=True), strict=True)
    return [found[k] for k in range(len(blocks))]


class _PartAtStart(NamedTuple):
    """A part of a state space: its matrix, the rows of the outputs, and the state at the start."""

    A: Floats
    C: Floats
    x: Floats  # less that at rest
    rests: bool  # x is so small that its modes are faint


@dataclass(frozen=True, slots=True, eq=False)
class _BoardAtStart:
    """A board's deviation from its rest at the start, in the parts of its state space."""

    blocks: Sequence[_PartAtStart]
    final: Floats  # (N,), V
    step: float  # largest deviation of an output, V

    @classmethod
    def of(cls, board: LinearBoard, initial: Initial) -> _BoardAtStart | None:
        """Return the start of a board; None if its modes do not show the response."""
        with suppress(EngineError):
            if is_exact(board):
                return cls._of(board, initial)
        return None

    @classmethod
    def _of(cls, board: LinearBoard, initial: Initial) -> _BoardAtStart | None:
        space, outputs, rest = board.state_space, board.circuit.outputs, board.equilibrium
        signs = np.array([out.sign for out in outputs])
        C = signs[:, None] * space.rows([out.node for out in outputs])[0]
        x = space.state_of(initial_unknowns(board, initial)) - space.state_of(rest.values)
        ends = np.cumsum([len(block.A) for block in space.blocks])[:-1]
        rows, parts = np.split(C, ends, axis=1), np.split(x, ends)
        small = FAINT / DEFECTIVE * float(np.abs(x).max(initial=0.0))
        blocks = [
            _PartAtStart(block.A, row, part, bool(np.abs(part).max(initial=0.0) <= small))
            for block, row, part in zip(space.blocks, rows, parts, strict=True)
        ]
        if not all(np.isfinite(block.A).all() for block in blocks):
            return None
        final = signs * [rest[out.node] for out in outputs]
        return cls(blocks, final, float(np.abs(C @ x).max(initial=0.0)))

    def outline(self, modes: Sequence[tuple[Complexes, Complexes | None]]) -> Outline | None:
        """Return the outline, given eigenvalues and vectors of each block."""
        shares = []
        for (poles, vectors), block in zip(modes, self.blocks, strict=True):
            if vectors is None:
                shares.append(np.zeros((len(poles), len(self.final)), dtype=np.complex128))
                continue
            try:
                weights = np.linalg.solve(vectors, block.x.astype(np.complex128))
            except np.linalg.LinAlgError:
                return None
            shares.append(weights[:, None] * (block.C @ vectors).T)
        found = Outline(
            np.concatenate([poles for poles, _ in modes]), np.concatenate(shares), self.final
        )
        largest = np.abs(found.share).max(initial=0.0)
        return found if largest <= DEFECTIVE * self.step else None


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
    yield _check("steady_state", static, checks.steady_state.tolerance, far=CLOSE)
    if checks.stability.margin <= 1.0:
        yield _check("stability", float(outline.poles.real.max()), 0.0)
    limited, band = checks.settling_time, checks.settling_time.band
    outside = np.flatnonzero((np.abs(u - ideal.target) > band * amplitude).any(axis=1))
    last = float(times[outside[-1]]) if outside.size else 0.0
    if static > CLOSE * band:
        yield Check(
            "settling_time", Outcome.FAIL, None, None, limited.max, None, "", "rests outside"
        )
    else:
        known = limited.max is not None and limited.min is None and static < band
        yield _check("settling_time", last if known else None, limited.max)
    for name, beyond in (
        ("overshoot", (u - ideal.target) * np.sign(step)),
        ("undershoot", (ideal.start - u) * np.sign(step)),
    ):
        limits = getattr(checks, name)
        if limits is not None:
            yield _check(name, float(beyond.max(initial=0.0)) / amplitude, limits.max)
    if checks.rise_time is not None:
        yield _slowest_rise(outline, scene, ideal, amplitude, times)


def _slowest_rise(
    outline: Outline, scene: Scene, ideal: IdealAnswer, amplitude: float, times: Floats
) -> Check:
    """Return the worst check of the rise times that the scene asks for, the slowest of several."""
    limits = scene.checks.rise_time or RiseTimeCheck()
    u, step = outline.at(times), ideal.target - ideal.start
    chosen = np.flatnonzero(np.abs(step) >= SMALL_STEP * amplitude).tolist()
    if limits.channel is not None:
        chosen = [k for k in [limits.channel - 1] if k in chosen]
    found = [_check("rise_time", None, limits.max)]
    for channel in chosen:
        progress = Progress(float(ideal.start[channel]), float(step[channel]), amplitude)
        rise = _rise(outline, channel, progress, times, progress(u[:, channel]), limits.max)
        found.append(_check("rise_time", rise, limits.max, limits.min, far=CLOSE))
    order = (Outcome.PASS, Outcome.INCONCLUSIVE, Outcome.FAIL)
    return max(
        found[1:] or found, key=lambda check: (order.index(check.outcome), check.value or math.inf)
    )


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
