"""Checks, their kinds and outcomes, and the evidence that decides them.

An undecided check is never a pass. `run_checks` has the table of all kinds.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from taction.netlist_gen.scene.check_keys import Checks
from taction.netlist_gen.scene.fields import Model
from taction.system.array_types import Floats
from taction.system.quantities import percent, show, show_rate
from taction.system.reading_definitions import READINGS
from taction.verification.readings.measurements import Measurements, describe_states
from taction.verification.readings.settling import ChannelState
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import Poles
from taction.verification.verdict.board import SteadyState
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads
from taction.verification.verdict.input_spread import InputSpread
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.run import Agreement, Run
from taction.verification.verdict.transient_plan import AFTER_SETTLING


class Outcome(enum.Enum):
    """The outcome of a check, or of a whole verification."""

    PASS = "pass"  # noqa: S105
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, slots=True)
class Check:
    """One check."""

    name: str
    outcome: Outcome
    value: float | None = None
    uncertainty: float | None = None  # bound on the error of `value`
    expected: float | None = None  # the limit; with `tolerance` the expected value
    tolerance: float | None = None  # accepted deviation from `expected`
    unit: str = ""  # "s", "1/s", "V", "step" (a fraction of the step amplitude) or "ratio"
    reason: str = ""
    band: float | None = None  # of a settling time: half its band, fraction of the step amplitude


@dataclass(frozen=True, slots=True)
class CheckKind:
    """One kind of check: an entry of `run_checks.CHECKS`, whose name is that of the check."""

    judge: Callable[[Evidence], Check | None]  # None if the scene does not ask for the check
    keys: type[Model] | None = None  # of the table ``[checks.NAME]``, which `limits` has by NAME


@dataclass(frozen=True, eq=False)
class Evidence:
    """The readings of a board, and all else that checks judge."""

    limits: Checks  # what the scene asks for: a field for each table ``[checks.NAME]``
    measurements: Measurements
    end_error: float  # bound on the error of the record's end, fraction of the step
    steady: SteadyState  # the equilibrium of the board, and what its modes leave at an instant
    end: float  # last instant of the record, s
    forever: bool  # whether the measurements hold for all time: they are those of an exact solution
    wanted: float  # error of the transient that the scene allows, fraction of the step amplitude
    agreement: Agreement | None  # None if only one engine ran, or if the board is unstable
    poles: Poles
    margin: Margin | None  # None if the scene asks for no stability margin
    reference_error: float  # bound on the error of the reference, fraction of the step amplitude
    reference_problem: str  # why the reference solution cannot be used, or empty
    contradiction: str = ""  # which number of the board differs from the reference's, or empty
    parts: PartLoads = NOT_LIMITED  # what the op-amps have to do, beside their limits
    noise: OutputNoise | None = None  # of the outputs; None if the scene has no limit for it
    spread: InputSpread | None = None  # where boards with other op-amps of the type rest
    unwitnessed: str = ""  # which of the two witnesses the board lacks, or empty
    run: Run | None = None  # the record with its error; None in evidence made by hand

    @property
    def reading_errors(
        self,
    ) -> Annotated[
        Mapping[str, float], {"inline": {name: kind.unit for name, kind in READINGS.items()}}
    ]:
        """Bounds on the errors of the readings: 0 for a time that no channel has."""
        found = {n: r.uncertainty if r else 0.0 for n, r in self.measurements.readings.items()}
        rises = (channel.rise_time for channel in self.measurements.channels)
        return found | {"rise_time": max((r.uncertainty for r in rises if r), default=0.0)}

    @property
    def no_step(self) -> str:
        """Why the step has no height to compare with, or an empty text."""
        rounding = ROUNDING if self.static_error >= 1.0 else ""
        return rounding if self.measurements.amplitude else NO_STEP

    @property
    def obstacle(self) -> str:
        """Why nothing can be judged against the reference, or an empty text."""
        doubt = "" if self.poles.certain else doubtful(self.poles)
        return self.reference_problem or self.no_step or doubt

    @property
    def growth(self) -> str:
        """How an unstable board behaves, by its poles; empty if it is not known to be unstable."""
        pole = self.poles.rightmost
        if not self.poles.known_unstable:
            return ""
        frequency = show(abs(pole.imag) / math.tau, "Hz")
        verb = f"oscillates at {frequency}" if pole.imag else "runs away"
        return f"{verb}, growth rate {show_rate(pole.real)}"

    @property
    def unsteady(self) -> str:
        """The states of the channels if one of them does not come to rest, or an empty text."""
        states = {channel.state for channel in self.measurements.channels}
        return describe_states(self.measurements) if states.intersection(UNSTEADY) else ""

    @property
    def disagreement(self) -> str:
        """How the transient contradicts stable poles, or an empty text."""
        states = self.unsteady
        return f"the poles are stable, the transient is not: {states}" if states else ""

    @property
    def perhaps_ringing(self) -> str:
        """Both readings of an undecided channel, if all other channels have settled."""
        states = {channel.state: channel for channel in self.measurements.channels}
        if not states.keys() <= {ChannelState.SETTLED, ChannelState.UNDECIDED}:
            return ""
        unclear = states.get(ChannelState.UNDECIDED)
        return f"channel {unclear.index + 1}: {unclear.reason}" if unclear else ""

    @property
    def targets(self) -> Floats:
        """The reference, (N,), V."""
        return np.array([channel.target for channel in self.measurements.channels])

    @property
    def static(self) -> float:
        """Largest distance of the equilibrium from the reference, fraction of the step."""
        return self._share(self.steady.values - self.targets)

    @property
    def static_error(self) -> float:
        """Bound on the error of `static`."""
        return self._share(self.steady.error) + self.reference_error

    @cached_property
    def resting(self) -> tuple[float, float, str]:
        """Distance from the reference at rest, its error, and which boards have it."""
        alike = self.static, self.static_error, ""
        if self.spread is None:
            return alike
        volts, error = map(self._share, self.spread.distance(self.targets))
        if volts <= self.static:
            return alike
        differ = "the input errors of their op-amps differ"
        if self.spread.changes:
            differ = "their parts differ, also by temperature or supply"
        text = (
            f"{SPREAD} are within, since {differ} (most: {self.spread.largest});"
            f" {percent(self.static)} with all of one sign"
        )
        return volts, error + self.static_error, text

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
SPREAD = "95 % of the boards"  # begins the reason of a distance that one board need not have
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


def undecided(name: str, unit: str, reason: str, limit: float | None) -> Check:
    """Return an inconclusive check without a value."""
    return Check(name, Outcome.INCONCLUSIVE, None, None, limit, None, unit, reason)


def doubtful(poles: Poles) -> str:
    """Return why it is open whether a board is stable."""
    if poles.doubt:
        return poles.doubt
    known = show(poles.resolution, "1/s", 2)
    return f"the rightmost pole is known to ±{known}: the board may be stable or unstable"


def joined(*texts: str) -> str:
    """Join the texts that are not empty."""
    return "; ".join(filter(None, texts))
