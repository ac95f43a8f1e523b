"""Checks, their outcomes, and the evidence that decides them.

An undecided check is never a pass. `run_checks` has the functions that decide.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from netlist_gen.quantities import show
from netlist_gen.scene.scene import Checks
from verification.measures.measurements import ChannelMeasure, Measurements
from verification.measures.settling import ChannelState
from verification.pipeline.agreement import Agreement
from verification.pipeline.steady_state import SteadyState
from verification.pipeline.step_error import StepError
from verification.pipeline.transient_plan import AFTER_SETTLING
from verification.small_signal.margin import Margin
from verification.small_signal.poles import Poles


class Outcome(enum.Enum):
    """The outcome of a check, or of a whole verification."""

    PASS = "pass"  # noqa: S105
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Attributes
    ----------
    value, uncertainty : float or None
        The measured value and the bound on its error, in `unit`.
    expected, tolerance : float or None
        The expected value and the accepted deviation, or the limit in `expected` alone.
    unit : str
        ``"s"``, ``"1/s"``, ``"step"`` (a fraction of the step amplitude) or ``"ratio"``.
    """

    name: str
    outcome: Outcome
    value: float | None
    uncertainty: float | None
    expected: float | None
    tolerance: float | None
    unit: str
    reason: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """The input of the checks.

    Attributes
    ----------
    steady : SteadyState
        The equilibrium of the board, and what its modes leave at an instant.
    end : float
        Last instant of the record, s.
    forever : bool
        Whether the measurements hold for all time, since they are those of an exact solution.
    wanted : float
        Error of the transient that the scene allows, fraction of the step amplitude.
    agreement : Agreement or None
        None if only one engine ran, or if the board is unstable.
    margin : Margin or None
        None if the scene asks for no stability margin.
    reference_error : float
        Bound on the error of the reference solution, fraction of the step amplitude.
    reference_problem : str
        Why the reference solution cannot be used, or empty.
    contradiction : str
        Which number of the board or the record differs from the reference's, or empty.
    """

    checks: Checks
    measurements: Measurements
    error: StepError
    steady: SteadyState
    end: float
    forever: bool
    wanted: float
    agreement: Agreement | None
    poles: Poles
    margin: Margin | None
    reference_error: float
    reference_problem: str
    contradiction: str = ""

    @property
    def no_step(self) -> str:
        """Why the step has no height to compare with, or an empty text."""
        rounding = ROUNDING if self.static_error >= 1.0 else ""
        return rounding if self.measurements.amplitude else NO_STEP

    @property
    def obstacle(self) -> str:
        """Why nothing can be judged against the reference, or an empty text."""
        doubt = "" if self.poles.certain else MAYBE.format(self.poles.resolution)
        return self.reference_problem or self.no_step or doubt

    @property
    def growth(self) -> str:
        """How an unstable board behaves, by its poles; empty if it is not known to be unstable."""
        pole = self.poles.rightmost
        if self.poles.stable or not self.poles.certain:
            return ""
        frequency = show(abs(pole.imag) / math.tau, "Hz")
        verb = f"oscillates at {frequency}" if pole.imag else "runs away"
        return f"{verb}, growth rate {pole.real:+.4g} /s"

    @property
    def unsteady(self) -> str:
        """The states of the channels if one of them does not come to rest, or an empty text."""
        states = {channel.state for channel in self.measurements.channels}
        return describe_states(self.measurements) if states.intersection(UNSTEADY) else ""

    @property
    def perhaps_ringing(self) -> str:
        """Both readings of an undecided channel, if all other channels have settled."""
        states = {channel.state: channel for channel in self.measurements.channels}
        if not states.keys() <= {ChannelState.SETTLED, ChannelState.UNDECIDED}:
            return ""
        unclear = states.get(ChannelState.UNDECIDED)
        return f"channel {unclear.index + 1}: {unclear.reason}" if unclear else ""

    @property
    def static(self) -> float:
        """Largest distance of the equilibrium from the reference, fraction of the step."""
        targets = [channel.target for channel in self.measurements.channels]
        return self._share(np.abs(self.steady.values - targets))

    @property
    def static_error(self) -> float:
        """Bound on the error of `static`."""
        return self._share(self.steady.error) + self.reference_error

    @property
    def at_end(self) -> float:
        """Largest distance of the end of the record from the reference, fraction of the step."""
        return self._share([each.final - each.target for each in self.measurements.channels])

    @property
    def apart(self) -> float:
        """Largest distance of the end of the record from the equilibrium, fraction of the step."""
        finals = np.array([channel.final for channel in self.measurements.channels])
        return self._share(finals - self.steady.values)

    @property
    def left(self) -> float:
        """What the modes leave after the record, fraction of the step."""
        return 0.0 if self.forever else self._share(self.steady.left(self.end))

    def too_short(self, share: float) -> str:
        """Return how long a record must be that leaves at most `share` of the step; else empty."""
        if self.forever or self.left <= share:
            return ""
        text = f"the record ends after {show(self.end, 's')}"
        if share <= 0.0:
            return f"{text} and moves on, and the limit leaves no room"
        needed = AFTER_SETTLING * self.steady.stop_for(share * self.measurements.amplitude)
        return f"{text}: analysis.stop = {show(needed, 's')} is needed"

    def _share(self, volts: ArrayLike) -> float:
        largest = float(np.abs(volts).max(initial=0.0))
        return largest / (self.measurements.amplitude or 1.0)


NO_STEP = "nothing to judge: with this strain and initial state no output has to move"
ROUNDING = (
    "nothing to judge: the step amplitude is below the rounding of the board's equilibrium,"
    " or below the error of the reference solution"
)
MAYBE = "the rightmost pole is known to ±{:.1g} /s: the board may be stable or unstable"
UNSTEADY = (ChannelState.OSCILLATING, ChannelState.CLIPPED, ChannelState.DIVERGED)


def overall(checks: Iterable[Check]) -> Outcome:
    """Fail if any check failed, else inconclusive if any is undecided, else pass."""
    outcomes = {check.outcome for check in checks}
    for worst in (Outcome.FAIL, Outcome.INCONCLUSIVE):
        if worst in outcomes:
            return worst
    return Outcome.PASS if outcomes else Outcome.INCONCLUSIVE


def at_most(value: float, uncertainty: float, limit: float) -> Outcome:
    """Compare with an upper limit; a difference within the uncertainty is inconclusive."""
    if not math.isfinite(value):
        return Outcome.INCONCLUSIVE
    if value + uncertainty <= limit:
        return Outcome.PASS
    return Outcome.FAIL if value - uncertainty > limit else Outcome.INCONCLUSIVE


def describe_states(measurements: Measurements) -> str:
    """Name the channels that have not settled, with the frequency and growth rate of ringing."""
    groups: dict[ChannelState, list[ChannelMeasure]] = {}
    for channel in measurements.channels:
        groups.setdefault(channel.state, []).append(channel)
    parts = []
    for state, channels in groups.items():
        if state is ChannelState.SETTLED:
            continue
        where = "channel " + ", ".join(str(channel.index + 1) for channel in channels)
        if len(channels) == len(measurements.channels) > 1:
            where = "every channel"
        text = f"{where} {state.value}"
        first = channels[0]
        if first.frequency is not None:
            text += f" at {show(first.frequency, 'Hz')}"
        if first.growth_rate is not None:
            text += f", growth rate {first.growth_rate:+.4g} /s"
        parts.append(text)
    return "; ".join(parts)
