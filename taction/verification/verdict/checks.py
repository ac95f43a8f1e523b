"""Checks, their outcomes, the evidence that decides them, and why a verdict is no pass.

An undecided check is never a pass. `run_checks` has the table of all kinds. A board that oscillates
never settles, never rests, and has no largest overshoot: four checks fail, for one cause.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from taction.netlist_gen.scene.check_keys import Checks
from taction.netlist_gen.scene.fields import Model
from taction.system.array_types import Floats
from taction.system.quantities import percent, show, show_rate, spaced
from taction.verification.readings.measurements import Measurements, describe_states
from taction.verification.readings.settling import ChannelState
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import Poles
from taction.verification.verdict.board import OutputNoise, SteadyState
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads
from taction.verification.verdict.input_spread import InputSpread
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """The readings of a board, and all else that checks judge; by default of an exact solution."""

    limits: Checks  # what the scene asks for: a field for each table ``[checks.NAME]``
    measurements: Measurements
    end_error: float = 0.0  # bound on the error of the record's end, fraction of the step
    steady: SteadyState  # the equilibrium of the board, and what its modes leave at an instant
    end: float = math.inf  # last instant of the record, s
    forever: bool = True  # whether the measurements hold for all time: they are of no record
    wanted: float  # error of the transient that the scene allows, fraction of the step amplitude
    agreement: Agreement | None = None  # None if only one engine ran, or if the board is unstable
    poles: Poles
    margin: Margin | None = None  # None if the scene asks for no stability margin
    reference_error: float = 0.0  # bound on the error of the reference, fraction of the step
    reference_problem: str = ""  # why the reference solution cannot be used, or empty
    contradiction: str = ""  # which number of the board differs from the reference's, or empty
    parts: PartLoads = NOT_LIMITED  # what the op-amps have to do, beside their limits
    noise: OutputNoise | None = None  # of the outputs; None if the scene has no limit for it
    spread: InputSpread | None = None  # where boards with other op-amps of the type rest
    unwitnessed: str = ""  # which of the two witnesses the board lacks, or empty
    run: Run | None = None  # the record with its error; None in evidence made by hand

    @property
    def no_step(self) -> str:
        """Why the step has no height to compare with, or an empty text."""
        rounding = ROUNDING if self.static_error >= 1.0 else ""
        return rounding if self.measurements.amplitude else NO_STEP

    @property
    def obstacle(self) -> str:
        """Why nothing can be judged against the reference, or an empty text."""
        doubt = doubtful(self.poles) if self.poles.stable is None else ""
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
        alone = f"{percent(self.static)} with all errors of one sign"
        differ = "op-amp input errors" if self.run is None else self.run.board.varies[1]
        text = f"{SPREAD} are within: {differ} differ from board to board; {alone}"
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


SEVERITY = (Outcome.PASS, Outcome.INCONCLUSIVE, Outcome.FAIL)


def overall(checks: Iterable[Check]) -> Outcome:
    """Fail if any check failed, else inconclusive if any is undecided or there is none."""
    outcomes = (check.outcome for check in checks)
    return max(outcomes, key=SEVERITY.index, default=Outcome.INCONCLUSIVE)


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


FIRST = ("same_problem", "stability", "steady_state")
"""Checks whose failure explains others; of several failures the first of these is named."""
SAYING = {
    "steady_state": "rests {} off the reference",
    "settling_time": "settles in {}",  # with its band
    "rise_time": "rises in {}",
    "overshoot": "overshoots by {}",
    "undershoot": "undershoots by {}",
    "stability": "has a stability margin of {}",
    "noise": "has an output noise of {}",
    "engines_agree": "differs by {} between two engines",
}
"""What a failed check says of the board; for another one, or without a value, its reason does."""
VALUELESS = ("headroom",)  # the reason has the value and the limit of the op-amp


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a verdict is no pass."""

    check: str  # the check that names the cause
    title: str  # the cause in a few words; of a failed check with value and limit
    text: str  # the same in full
    follows: tuple[str, ...] = ()  # the checks that fail, or are not decided, for the same cause


def cause(checks: Sequence[Check]) -> Cause | None:
    """Return the first of `causes`; None if all checks pass."""
    return next(causes(checks), None)


def causes(checks: Sequence[Check]) -> Iterator[Cause]:
    """Yield every cause for which checks are no pass, those of failures first."""
    follows = following(checks)
    own = [check for check in checks if check.name not in follows]
    failed = [check for check in own if check.outcome is Outcome.FAIL]
    failed.sort(key=lambda check: FIRST.index(check.name) if check.name in FIRST else len(FIRST))
    for number, check in enumerate(failed):
        text = said(check)
        yield Cause(check.name, text, text, () if number else follows)
    alike: dict[str, list[str]] = {}
    for check in own:
        if check.outcome is Outcome.INCONCLUSIVE:
            alike.setdefault(check.reason, []).append(check.name)
    for reason, (name, *others) in alike.items():
        title = f"{listed((name, *others))} not decided"
        yield Cause(name, title, f"{title}: {reason}", tuple(others))
    if not checks:
        yield Cause("", "no check was made", "no check was made")


def following(checks: Sequence[Check]) -> tuple[str, ...]:
    """Return the checks that fail, or are not decided, only because another one fails."""
    failed = {check.name: check for check in checks if check.outcome is Outcome.FAIL}
    stability, steady = failed.get("stability"), failed.get("steady_state")
    if stability is not None and is_unstable(stability):
        lost = (check.name for check in checks if check.outcome is not Outcome.PASS)
        return tuple(name for name in lost if name not in FIRST[:2])
    if steady is None:
        return ()
    lost = (name for name, check in failed.items() if check.value is None and check.unit == "s")
    if _keeps_limit(steady):
        lost = (name for name, check in failed.items() if _keeps_limit(check) or not check.value)
    return tuple(name for name in lost if name not in FIRST)


def is_unstable(stability: Check) -> bool:
    """Whether a failed check of the stability is that of an unstable board."""
    return stability.unit == "1/s" or not stability.value


def said(check: Check) -> str:
    """Return what a failed check says of the board, with value and limit."""
    unstable = check.name == "stability" and is_unstable(check)
    if unstable or check.value is None or _keeps_limit(check) or check.name in VALUELESS:
        text = check.reason.partition("; ")[0]
        return f"{text} (limit: below 0 /s)" if unstable else text
    text = SAYING.get(check.name, f"{spaced(check.name)}: {{}}")
    text = text.replace("settles", f"settles {band_text(check)}".rstrip(), 1)
    if SPREAD in check.reason:
        text = f"{text.replace('rests', 'rests up to')} in {SPREAD}"
    return f"{text.format(amount(check.value, check.unit))}{_missed(check, check.value)}"


def band_text(check: Check) -> str:
    """Return the band of a settling time: ``"to ±1 %"``; empty for another check."""
    return "" if check.band is None else f"to ±{100.0 * check.band:g} %"


def _missed(check: Check, value: float) -> str:
    """Return the limit that a value misses: the upper one, or for a small one the least."""
    limit, least = _limit(check), check.reason.rpartition("; ")[2]
    if limit is not None and check.tolerance is not None and check.expected:
        wanted = amount(check.expected, check.unit)
        return f" (expected: {wanted} ± {amount(limit, check.unit)})"
    if limit is None or value < limit:
        if least.startswith("at least "):  # the scene has a smallest time, too
            return f" (limit: {least})"
        return "" if limit is None else f" (limit: at least {amount(limit, check.unit)})"
    return f" (limit: at most {amount(limit, check.unit)})"


def _limit(check: Check) -> float | None:
    return check.expected if check.tolerance is None else check.tolerance


def _keeps_limit(check: Check) -> bool:
    """Whether the value alone keeps the limit: the outputs do not come to rest."""
    limit = _limit(check)
    known = check.unit == "step" and check.value is not None and limit is not None
    return known and abs(check.value or 0.0) <= (limit or 0.0)


def amount(value: float, unit: str) -> str:
    """Return a value of a check with its unit."""
    if unit == "step":
        return f"{Decimal(f'{100.0 * value:.3g}'):f} %"
    return f"{value:.4g}" if unit in ("", "ratio") else show(value, unit)


def listed(names: Sequence[str]) -> str:
    """Return names of checks in words: ``"steady state, overshoot"``."""
    return ", ".join(map(spaced, names))
