"""Time scales of a board: how long its strain step must be simulated, and how finely."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from netlist_gen.circuit import Circuit
from verification.engines.coarse import coarsen
from verification.engines.descriptor import linearise, modes_of
from verification.engines.equilibrium import LARGE, Equilibrium, equilibrium
from verification.engines.initial import initial_state
from verification.engines.modes import Complexes, Floats, Modes
from verification.engines.stamps import stamp

GROWN = 10.0  # an instability counts as seen once it is this many step amplitudes high
INVISIBLE = 1e-12  # amplitude that rounding and asymmetry lend to a mode nothing excites
RESOLVED = 1e6  # step amplitudes: modes that must cancel to more than that are defective
UNRESOLVED = 1e6  # amplitude given to each of them else: t^k exp(-t) peaks higher than exp(-t)
RINGS = 1.0 / math.sqrt(2.0)  # a mode rings if its damping ratio is below this


@dataclass(frozen=True, slots=True)
class Ringing:
    """One oscillating mode that the strain step excites.

    Attributes
    ----------
    frequency, period : float
        Hz, s.
    decay : float
        Time constant of its envelope, s; negative where it grows.
    amplitude : float
        Largest initial amplitude over the outputs, in step amplitudes.
    """

    frequency: float
    period: float
    decay: float
    amplitude: float


@dataclass(frozen=True, slots=True, eq=False)
class TimeScales:
    """How long to simulate a board, and how finely, from the modes that its step excites.

    Attributes
    ----------
    poles : ndarray (n,)
        1/s, rightmost first.
    amplitudes : ndarray (n,)
        Largest share of each mode in any output, in step amplitudes.
    slowest : float
        Time constant of the slowest decaying mode that matters, s.
    ringing : tuple of Ringing
        Oscillating modes that matter, the fastest first.
    rise_time : float
        10-90 % of the output with the largest step, s; infinite where it is never reached, or
        where modes are defective.
    growth_time : float
        When the fastest growing mode stands `GROWN` step amplitudes high, s; infinite if stable.
    stop : float
        Suggested stop time, s.
    max_step : float
        Suggested maximum step, s.
    complete : bool
        Whether `poles` are those of the board itself; False for a large board, where they are
        those of its coarse image (`engines.coarse`) and not to be judged by.
    """

    poles: Complexes
    amplitudes: Floats
    slowest: float
    ringing: tuple[Ringing, ...]
    rise_time: float
    growth_time: float
    stop: float
    max_step: float
    complete: bool = True

    def stop_for(self, error: float) -> float:
        """Time after which all decaying modes together stay below `error` step amplitudes, s.

        An unstable board gets the time to show it (`growth_time`) where that is longer. Not
        bounded: a pole close to the imaginary axis makes it as long as it must be.
        """
        decaying = self.poles.real < 0.0
        weight, rate = self.amplitudes[decaying], self.poles.real[decaying]
        settled = last_crossing(weight, rate, error)
        return max(settled, self.growth_time) if math.isfinite(self.growth_time) else settled

    def max_step_for(self, points: float) -> float:
        """Return the step that puts `points` points on the period of the fastest ringing, s.

        Without ringing, the fastest mode with a tenth of the step amplitude takes its place, with
        ``2 pi / |p|`` for a period.
        """
        if self.ringing:
            return self.ringing[0].period / points
        large = np.abs(self.poles[self.amplitudes >= 0.1 * self.amplitudes.max(initial=0.0)])
        return 2.0 * math.pi / float(large.max()) / points if len(large) else math.inf


def last_crossing(weight: Floats, rate: Floats, level: float) -> float:
    """Solve ``sum weight exp(rate t) = level`` for t (rates negative) by bisection."""
    if not len(weight) or weight.sum() <= level:
        return 0.0
    low, high = 0.0, float(np.max(np.log(np.maximum(weight * len(weight) / level, 1.0)) / -rate))
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        if float(weight @ np.exp(rate * middle)) > level:
            low = middle
        else:
            high = middle
    return high


def time_scales(
    circuit: Circuit,
    *,
    error: float = 1e-4,
    points: float = 60.0,
    initial: Literal["zero", "rest"] = "zero",
    at: Equilibrium | None = None,
) -> TimeScales:
    """Find the time scales that the strain step shows at the outputs.

    Parameters
    ----------
    error : float
        Modes below this many step amplitudes do not matter; `stop` leaves this much.
    points : float
        Points that `max_step` puts on the fastest ringing period.
    initial : str
        As `netlist_gen.analysis.Transient` has it.
    at : Equilibrium, optional
        Linearise here; by default the equilibrium with the strain applied. For an exponential
        board the large step is followed with the modes of this equilibrium, an estimate.

    Raises
    ------
    EngineError
        No state-space form, or no equilibrium.
    """
    descriptor = stamp(circuit)
    large = descriptor.size > LARGE
    if large:
        descriptor, at = coarsen(descriptor), None
    at = at or equilibrium(descriptor)
    space = linearise(descriptor, at)
    modes = modes_of(space)
    shown = {output.node for output in circuit.outputs}.intersection(space.nodes)
    C, _ = space.rows(tuple(sorted(shown)))
    target = space.charge @ at.values + space.charge_offset
    deviation = initial_state(space, initial) - target
    step = float(np.abs(C @ deviation).max(initial=0.0))
    share = np.zeros((len(C), space.n), dtype=np.complex128)
    weight = np.ones(space.n)
    if step > 0.0:
        with np.errstate(invalid="ignore", over="ignore"):
            share = modes.amplitudes(C, deviation) / step
            weight = np.abs(share).max(axis=0, initial=0.0)
        if not weight.sum() < RESOLVED:
            share, weight = np.zeros_like(share), np.full(space.n, UNRESOLVED)
    return replace(_scales(modes, weight, share, error, points), complete=not large)


def _scales(
    modes: Modes, weight: Floats, share: Complexes, error: float, points: float
) -> TimeScales:
    p = modes.poles
    matters = weight >= error
    decay = -1.0 / p.real[matters & (p.real < 0.0)]
    rings = matters & (p.imag > 0.0) & (-p.real < RINGS * np.abs(p))
    growing = p.real > 0.0
    growth = np.log(GROWN / np.maximum(weight[growing], INVISIBLE)) / p.real[growing]
    scales = TimeScales(
        poles=p,
        amplitudes=weight,
        slowest=float(decay.max(initial=0.0)),
        ringing=tuple(sorted(_ringing(p[rings], 2.0 * weight[rings]), key=lambda r: r.period)),
        rise_time=_rise_time(p, share),
        growth_time=float(np.maximum(growth, 0.0).min(initial=math.inf)),
        stop=0.0,
        max_step=0.0,
    )
    return replace(scales, stop=scales.stop_for(error), max_step=scales.max_step_for(points))


def _ringing(poles_: Complexes, amplitudes: Floats) -> Iterable[Ringing]:
    for p, amplitude in zip(poles_.tolist(), amplitudes.tolist(), strict=True):
        frequency = p.imag / (2.0 * math.pi)
        yield Ringing(frequency, 1.0 / frequency, -1.0 / p.real, amplitude)


def _rise_time(p: Complexes, share: Complexes) -> float:
    """10-90 % of the output with the largest step, on a grid of 2000 points; an estimate."""
    if not np.any(share):
        return math.inf
    row = share[int(np.argmax(np.abs(share.sum(axis=1))))]
    row = row / -row.sum()
    large = np.abs(row) > 1e-3
    if np.any(p.real[large] >= 0.0):
        large &= p.real < 0.0
    fast, slow = np.abs(p[large]).max(initial=0.0), np.abs(p[large]).min(initial=math.inf)
    if fast == 0.0:
        return math.inf
    t = np.geomspace(1e-3 / fast, 10.0 / slow, 2000)
    response = 1.0 + (np.exp(np.outer(t, p[large])) @ row[large]).real
    tenth, most = np.flatnonzero(response >= 0.1), np.flatnonzero(response >= 0.9)
    if not len(tenth) or not len(most):
        return math.inf
    return float(t[most[0]] - t[tenth[0]])
