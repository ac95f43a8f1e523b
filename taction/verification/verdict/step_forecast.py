"""Forecast of the step control of ngspice on a board, before ngspice runs.

ngspice (``CKTterr``) chooses every step h of the trapezoidal rule such that the local error of each
capacitor's charge q stays below a tolerance,

    h² |q'''| / 72 <= truncation · max(|q'| + current, max(|q|, charge) / h),

and never above a maximum step. The modes of a board give q at any time, so they give the step at
any time and the number of steps. They also give the error of the outputs: a step multiplies each
mode by ``(1 + hp/2) / (1 - hp/2)`` instead of ``exp(hp)``. No transient is simulated.

The forecast omits the start of ngspice (up to 50 steps). For a board with behavioural amplifiers,
and for the coarse board of a large board, the measured error is within a factor of 2 of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from taction.spice_models.subcircuits import STAGE_CAPACITANCE
from taction.system.array_types import EPS, Complexes, Floats
from taction.verification.engines.statespace.linearised.linear_board import (
    Initial,
    LinearBoard,
    initial_unknowns,
)

TINY = 1e-280  # in the place of zero
LARGEST = 300.0  # exponent
CKTTERR = 72.0  # 12 of the trapezoidal rule's local error times 3! of the divided difference
INSTANTS = 240  # number of instants of the forecast, in geometric progression
EARLIEST = 0.01  # of the fastest time constant: the first instant after 0
ROUNDINGS = 200.0  # times rounding: a charge's error over the first steps, a hundredth of it
UNSEEN = 1e-9  # of the step amplitude: smaller modes are ignored at the outputs
FEWEST_STEPS = (50.0, 100.0, 200.0, 500.0, 1500.0)
"""Candidates for the least number of steps of a record. With the trapezoidal rule an unresolved
stiff mode decays more slowly the longer the step is: if this limits the error, a shorter maximum
step is cheaper than a smaller truncation error."""
FIRST = 0.1  # of the step that the charges allow at t = 0: the first step
FEWEST_INSTANTS = 200.0  # least number of instants of a record
MOST_INSTANTS = 500_000  # and the largest
MOVE = 0.02  # of the step amplitude: largest change of an output between two instants
CHARGE = 10.0  # times C times the step amplitude: above the charges of usual boards
EXPONENT = 1.5  # the truncation error is proportional to this power of the error
SEARCH_AIM = 0.93  # of the allowed error: target of each search step
CLOSE = 0.8  # of the allowed error: the search stops above this fraction
TRIES = 12
LEAST, MOST = 1e-15, 0.5  # truncation errors


@dataclass(frozen=True, slots=True)
class StepForecast:
    """A step control and the forecast of its steps and error."""

    truncation: float  # local error that one step may make, relative
    charge: float  # charge below which the truncation error is absolute, C
    # `max_step`, `first_step`: maximum and first step, s.
    max_step: float
    first_step: float
    steps: float  # number of accepted steps
    error: float  # largest error of any output at any time, in step amplitudes


@dataclass(frozen=True, eq=False)
class StepModel:
    """The step control of one board over one record."""

    time: Floats  # (T,): s, from 0 to the end of the record
    poles: Complexes  # (n,): modes that show at the outputs, one of each conjugate pair, 1/s
    shares: Complexes  # (n, N): their amplitudes at the outputs, in step amplitudes
    # `all_poles`, `charges`: (m,) and (m, Q): all modes, and their amplitudes in every charge, 1/s
    # and C.
    all_poles: Complexes
    charges: Complexes
    rest: Floats  # (Q,): the charges at rest, C
    charge: float  # charge below which the truncation error is absolute, C
    amplitude: float  # step amplitude, V
    current: float = 0.0  # current up to which the truncation error is absolute, A

    @classmethod
    def of(
        cls, board: LinearBoard, stop: float, initial: Initial = "zero", *, stable: bool = False
    ) -> StepModel:
        """Model the strain step of `board` up to `stop`, s; a large board by its coarse board.

        A growing mode of the coarse image of a `stable` board is taken as decaying at its rate.
        """
        coarse = board.descriptor.is_large
        board = board.coarse if coarse else board
        space, equations, rest = board.state_space, board.descriptor, board.equilibrium.values
        C, _ = space.rows(equations.names)
        deviation = initial_unknowns(board, initial) - rest
        kept = space.modes.centres.imag >= 0.0  # one of each conjugate pair, which counts twice
        poles, modes = space.modes.centres[kept], space.modes.shares(C, deviation).amplitudes.T
        modes = np.where(poles.imag > 0.0, 2.0, 1.0)[:, None] * modes[kept]
        if coarse and stable:
            poles = -np.abs(poles.real) + 1j * poles.imag
        farads = np.ones(equations.size)
        farads[equations.node_count :] = STAGE_CAPACITANCE
        held = equations.dense.mass.T * farads
        charges = modes @ held
        charged = np.abs(charges).max(axis=0, initial=0.0) > 0.0
        outputs = [node for node in board.reported(None) if node in equations.places]
        shares = modes[:, [equations.places[node] for node in outputs]]
        amplitude = float(np.abs(shares.sum(axis=0).real).max(initial=0.0))
        largest = float(np.abs(shares).max(initial=0.0))
        if amplitude <= UNSEEN * largest:  # the outputs return to where they were
            amplitude = largest or 1.0
        shown = np.abs(shares).max(axis=1, initial=0.0) > UNSEEN * amplitude
        earliest = min(EARLIEST / float(np.abs(poles).max(initial=1.0 / stop)), 0.5 * stop)
        return cls(
            time=np.concatenate([[0.0], np.geomspace(earliest, stop, INSTANTS)]),
            poles=poles[shown],
            shares=shares[shown] / amplitude,
            all_poles=poles,
            charges=charges[:, charged],
            rest=(rest @ held)[charged],
            charge=CHARGE * board.circuit.charged_capacitance * amplitude,
            amplitude=amplitude,
        )

    def above_rounding(self, relative: float) -> StepModel:
        """Return the model with an absolute error of currents above the rounding of the charges.

        A large charge at rest, such as that of a coupling capacitor, rounds its current by more
        than a small current may change by a `relative` error.
        """
        shortest = float(self.time[1]) if len(self.time) > 1 else math.inf
        charge = float(np.abs(self.rest).max(initial=0.0))
        return replace(self, current=ROUNDINGS * EPS * charge / shortest / relative)

    @cached_property
    def growth(self) -> Complexes:
        """``exp(p t)`` of the modes that show, shape (T, n)."""
        return limited_exp(np.multiply.outer(self.time, self.poles))

    @cached_property
    def limits(self) -> tuple[Floats, Floats]:
        """The longest steps that charges and currents allow at a truncation error of 1, s, (T,)."""
        growth = limited_exp(np.multiply.outer(self.time, self.all_poles))
        first, second = (self.all_poles[:, None] ** k * self.charges for k in (1, 3))
        third = np.maximum(np.abs((growth @ second).real), TINY)
        size = np.maximum(np.abs((growth @ self.charges).real + self.rest), self.charge)
        by_charge = np.cbrt(CKTTERR * (size / third).min(axis=1, initial=self.charge / TINY))
        current = np.abs((growth @ first).real) + self.current
        by_current = np.sqrt(CKTTERR * (current / third).min(axis=1, initial=math.inf))
        return by_charge, by_current

    def step_lengths(self, truncation: float, max_step: float) -> Floats:
        """Return the step at every instant of `time`, s, shape (T,)."""
        by_charge, by_current = self.limits
        allowed = np.maximum(by_charge * truncation ** (1 / 3), by_current * truncation ** (1 / 2))
        return np.asarray(np.minimum(allowed, max_step))

    def forecast(self, truncation: float, max_step: float) -> StepForecast:
        """Forecast the run of ngspice with a truncation error and a maximum step, s."""
        step = self.step_lengths(truncation, max_step)[:, None]
        drift = integral(slip(step, self.poles), self.time)
        off = limited_exp(np.multiply.outer(self.time, self.poles) + drift) - self.growth
        return StepForecast(
            truncation=truncation,
            charge=self.charge,
            max_step=max_step,
            first_step=FIRST * float(step[0, 0]),
            steps=float(integral(1.0 / step[:, 0], self.time)[-1]),
            error=float(np.abs((off @ self.shares).real).max(initial=0.0)),
        )

    def even(self, max_step: float) -> StepForecast:
        """Forecast a run with even steps of `max_step`, s; only faster modes get shorter steps."""
        truncation = (max_step * float(np.abs(self.poles.imag).max(initial=0.0))) ** 3 / 6.0
        return self.forecast(min(max(truncation / CHARGE, LEAST), MOST), max_step)

    def reached(self, forecast: StepForecast, steps: float) -> float:
        """Return the instant at which a run of `forecast` has taken `steps` steps, s."""
        rate = 1.0 / self.step_lengths(forecast.truncation, forecast.max_step)
        return float(np.interp(steps, integral(rate, self.time), self.time))

    def instants(self, error: float) -> Floats:
        """Return the instants of a record whose cubic interpolation errs by `error`, s.

        The error of a cubic through four points h apart is ``h⁴ |d⁴u/dt⁴| 3/128``, here in step
        amplitudes.
        """
        rate = np.abs(self.growth @ (self.poles[:, None] * self.shares)).max(axis=1, initial=TINY)
        bend = np.abs(self.growth @ (self.poles[:, None] ** 4 * self.shares))
        bend = np.maximum(bend.max(axis=1, initial=0.0), TINY)
        longest = np.minimum(self.time[-1] / FEWEST_INSTANTS, MOVE / rate)
        spacing = np.minimum((128.0 / 3.0 * error / bend) ** 0.25, longest)
        count = integral(1.0 / spacing, self.time)
        places = np.linspace(0.0, count[-1], min(math.ceil(count[-1]) + 1, MOST_INSTANTS))
        return np.asarray(np.interp(places, count, self.time))

    def cheapest(self, error: float) -> StepForecast:
        """Return the step control with the fewest steps whose error stays within `error`.

        If no step control does, return the one with the smallest error.
        """
        found, stop, begin = list[StepForecast](), float(self.time[-1]), 1e-6
        for fewest in FEWEST_STEPS:
            found.append(self._within(error, stop / fewest, begin))
            best = min(found, key=lambda each: (max(each.error, error), each.steps))
            begin = best.truncation
            if best.error <= error and best.steps <= 4.0 * fewest:
                break  # no shorter maximum step has fewer steps
        return best

    def _within(self, error: float, max_step: float, truncation: float) -> StepForecast:
        """Search the largest truncation error whose forecast stays within `error`."""
        low, high, best = LEAST, MOST, None
        for _ in range(TRIES):
            forecast = self.forecast(truncation, max_step)
            if forecast.error <= error:
                low, best = truncation, forecast
                if forecast.error >= CLOSE * error or truncation >= MOST:
                    break
            else:
                high = truncation
            ratio = SEARCH_AIM * error / max(forecast.error, TINY)
            following = min(truncation * min(ratio, 1e12) ** EXPONENT, MOST)
            inside = low < following < high or (following == high == MOST)
            truncation = following if inside else math.sqrt(low * high)
        return best or forecast


def slip(step: Floats, poles: Complexes) -> Complexes:
    """Return ``(log((1 + z) / (1 - z)) - 2 z) / step`` with ``z = step poles / 2``, Im z >= 0.

    A step of exactly ``-2 / p`` removes a mode p; its logarithm is limited to that of `TINY`.
    """
    z = 0.5 * step * poles
    ratio = (1.0 + z) / (1.0 - z)
    return np.asarray((np.log(np.where(ratio == 0.0, TINY, ratio)) - 2.0 * z) / step)


def integral(rate: Any, time: Floats) -> Any:
    """Integrate `rate`, (T,) or (T, n), over `time` by the trapezoidal rule; the same shape."""
    found = np.zeros_like(rate)
    np.cumsum((0.5 * (rate[1:] + rate[:-1])).T * np.diff(time), axis=-1, out=found[1:].T)
    return found


def limited_exp(exponents: Complexes) -> Complexes:
    """Return the exponential, limited to ``exp(LARGEST)``."""
    return np.asarray(np.exp(np.minimum(exponents.real, LARGEST) + 1j * exponents.imag))
