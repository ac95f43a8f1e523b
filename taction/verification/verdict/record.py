"""A verdict as one flat record: outcome, figures, checks, channels.

Every study keeps records, never verdicts: a sweep a record a point, a yield a record a sample, a
baseline a record a scene. `compare` compares two of them. A verification that reached no verdict
has a record, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Generic, TypeVar

from taction.system.array_types import Floats
from taction.system.documents import Inline
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.readings.measurements import ChannelMeasure, Measurements
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict.cause import cause
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.verify import Verdict

T = TypeVar("T")

ERROR = "error"
"""Outcome of a verification that reached no verdict."""
MAX_REASON = 4000  # characters
STATES = tuple(ChannelState)  # the best first; of several channels the worst state counts


@dataclass(frozen=True, slots=True)
class FigureRule(Generic[T]):
    """How a figure is read from a verdict or from a channel."""

    unit: str  # SI, "step" for fractions of the step amplitude, or empty for a plain number
    read: Callable[[T], Reading | float | None]
    error: Callable[[T], float | None] | None = None  # bound; of a `Reading` its own

    def figure(self, source: T) -> Figure:
        """Return the figure; its value is None where the source has none."""
        found = self.read(source)
        value = finite(found)
        if value is None:
            return Figure(None, self.unit)
        if isinstance(found, Reading):
            bound, other = finite(found.uncertainty), found.alternative
            return Figure(value, self.unit, bound, other, fragile=found.fragile)
        bound = None if self.error is None else finite(self.error(source))
        return Figure(value, self.unit, bound)


@dataclass(frozen=True, slots=True)
class Figure:
    """A number that a verdict states.

    Attributes
    ----------
    value : float or None
        None where the board has no such number.
    uncertainty : float or None
        Bound on the error; None where it is unknown.
    alternative : float or None
        Of a fragile time: its value after a small change of a level; None where it then is missing.
    fragile : bool
        Whether a small change of a level moves it.
    """

    value: float | None
    unit: str = ""
    uncertainty: float | None = None
    alternative: float | None = None
    fragile: bool = False


def finite(value: Reading | float | None) -> float | None:
    """Return a number, or the value of a reading, where it is finite."""
    if isinstance(value, Reading):
        value = value.value
    return float(value) if value is not None and math.isfinite(value) else None


def signed_errors(verdict: Verdict) -> tuple[float, ...]:
    """Return equilibrium minus reference of every channel, fractions of the step amplitude."""
    return tuple(_relative(verdict, verdict.steady.values))


def _relative(verdict: Verdict, u: Floats) -> list[float]:
    """Return outputs (N,), V, minus the reference, fractions of the step amplitude."""
    amplitude = verdict.measurements.amplitude or math.nan
    return [float(off) / amplitude for off in u - verdict.ideal.target]


def _rest_error(verdict: Verdict) -> float:
    amplitude = verdict.measurements.amplitude
    return verdict.steady.error / amplitude + verdict.ideal.error if amplitude else math.inf


def _of_network(name: str) -> Callable[[Verdict], Reading | None]:
    return lambda verdict: verdict.measurements.readings[name]


def _of_channel(name: str) -> Callable[[ChannelMeasure], Reading | None]:
    return lambda channel: channel.readings[name]


FIGURES: dict[str, FigureRule[Verdict]] = {
    **{name: FigureRule(kind.unit, _of_network(name)) for name, kind in READINGS.items()},
    "steady_state_error": FigureRule(
        "step", lambda v: max(map(abs, signed_errors(v))), _rest_error
    ),
    "end_error": FigureRule(
        "step",
        lambda v: max(map(abs, _relative(v, v.run.first_and_last[-1]))),
        lambda v: v.error.steady_state + v.ideal.error,
    ),
    "growth_rate": FigureRule(
        "1/s", lambda v: v.poles.rightmost.real, lambda v: v.poles.resolution
    ),
    "frequency": FigureRule("Hz", lambda v: abs(v.poles.rightmost.imag) / (2.0 * math.pi)),
    "damping_ratio": FigureRule("", lambda v: v.poles.damping_ratio),
    "margin": FigureRule("", lambda v: None if v.margin is None else v.margin.factor),
    "noise": FigureRule("V", lambda v: None if v.noise is None else v.noise.known),
    "step_amplitude": FigureRule(
        "V", lambda v: v.measurements.amplitude, lambda v: v.ideal.error * v.measurements.amplitude
    ),
    "lambda": FigureRule("", lambda v: v.circuit.value("lambda")),
    "resistance": FigureRule("ohm", lambda v: v.circuit.number("R")),
    "wanted_error": FigureRule("step", lambda v: v.board.plan.wanted),
    "attained_error": FigureRule("step", lambda v: v.run.achieved),
    "simulation_error": FigureRule("step", lambda v: v.error.steady_state),
    "seconds": FigureRule("s", lambda v: v.timing["total"]),
}
"""Figures of the whole board; the worst channel counts."""

POLE_READINGS = ("growth_rate", "frequency", "damping_ratio", "margin")
"""Figures that say how a board behaves; the others follow from the design or from the run."""

CHANNEL_FIGURES: dict[str, FigureRule[ChannelMeasure]] = {
    "reference": FigureRule("V", lambda c: c.target),
    "final": FigureRule("V", lambda c: c.final),
    **{name: FigureRule(kind.unit, _of_channel(name)) for name, kind in READINGS.items()},
    "frequency": FigureRule("Hz", lambda c: c.frequency),
    "growth_rate": FigureRule("1/s", lambda c: c.growth_rate),
}
"""Figures of one channel; a verdict has its `equilibrium` (V) in addition."""

UNITS = {name: rule.unit for name, rule in FIGURES.items()}
WITHOUT_REST = {name: Figure(None, UNITS[name]) for name in ("rise_time", *EXCURSIONS)}
"""Of a board that is not known to be stable: they depend on the length of its record."""
CHANNEL_UNITS = {name: rule.unit for name, rule in CHANNEL_FIGURES.items()} | {"equilibrium": "V"}

Bounds = dict[str, float | None]
"""By the name of a figure."""


@dataclass(frozen=True, slots=True)
class Channel:
    """Figures of one output; `index` counts from 1, as the node names do."""

    SHOWN: ClassVar[tuple[str, ...]] = ("fragile",)

    index: int
    state: str  # at the end of the record
    figures: Annotated[dict[str, float | None], Inline(CHANNEL_UNITS)]
    uncertainties: Bounds = field(default_factory=dict)  # null: unknown
    alternatives: Bounds = field(default_factory=dict)  # of fragile times, s
    reason: str = ""  # why a time is missing

    @property
    def fragile(self) -> bool:
        """Whether a small change of a level moves a time."""
        return bool(self.alternatives)

    @classmethod
    def of(cls, measure: ChannelMeasure, known: Mapping[str, Figure] = {}) -> Channel:
        """Return the figures of a channel; those in `known` are not of its transient."""
        found = {name: rule.figure(measure) for name, rule in CHANNEL_FIGURES.items()}
        found |= {"equilibrium": Figure(None, "V"), **known}
        reason = measure.reason or measure.rise_reason
        return cls(measure.index + 1, measure.state.value, *three(found), reason)

    def figure(self, name: str) -> Figure:
        """Return a figure; one that the channel lacks has the value None."""
        return _figure(self, name, CHANNEL_UNITS)


@dataclass(frozen=True, slots=True)
class Record:
    """A verdict as flat data, or why there is none."""

    outcome: str  # ``"pass"``, ``"fail"``, ``"inconclusive"``, or `ERROR`: no verdict was reached
    # `engine`, `simulator`: ``"ngspice"`` or ``"statespace"``; the same with its version, None
    # without a verdict.
    engine: str
    simulator: str | None = None
    # Name of the exception that ended the verification; None of a verdict.
    failure: str | None = None
    reason: str = ""  # why the outcome is not pass
    state: str | None = None  # state of the worst channel at the end of the record
    stable: bool | None = None
    # By the names in `FIGURES`; None where the board has no such figure. A board that is not known
    # to be stable has no rise time and no excursions: they depend on its record's length.
    figures: Annotated[dict[str, float | None], Inline(UNITS)] = field(default_factory=dict)
    # Bounds on their errors, where there is one; None where it is infinite.
    uncertainties: Bounds = field(default_factory=dict)
    # Of fragile times, the value after a small change of a level, None where there is none.
    alternatives: Bounds = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    channels: tuple[Channel, ...] = ()

    @classmethod
    def of(cls, verdict: Verdict, *, channels: bool = True) -> Record:
        """Return the record of a verdict; without `channels` only of the whole board."""
        engine = verdict.run.ends.engine
        found = {name: rule.figure(verdict) for name, rule in FIGURES.items()}
        if verdict.poles.stable is not True:
            found |= WITHOUT_REST
        state = max((c.state for c in verdict.measurements.channels), key=STATES.index)
        return cls(
            verdict.outcome.value,
            engine.partition("-")[0],
            engine,
            None,
            decisive_reason(verdict),
            state.value,
            verdict.poles.stable,
            *three(found),
            verdict.checks,
            _channels(verdict) if channels else (),
        )

    @classmethod
    def without_verdict(cls, failure: str, reason: str, engine: str) -> Record:
        """Return the record of a verification that an exception ended."""
        text, figures = reason[:MAX_REASON], dict.fromkeys(FIGURES)
        return cls(ERROR, engine, failure=failure, reason=text, figures=figures)

    def without_run_time(self) -> Record:
        """Return the record without how long the run took: the same board gives the same record."""
        return replace(self, figures=self.figures | {"seconds": None})

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the checks that do not pass."""
        return tuple(c.name for c in self.checks if c.outcome is not Outcome.PASS)

    @property
    def pole(self) -> tuple[float, float] | None:
        """Rightmost pole, 1/s: real and imaginary part; None without a verdict."""
        rate, frequency = self.value("growth_rate"), self.value("frequency")
        return None if rate is None or frequency is None else (rate, 2.0 * math.pi * frequency)

    def value(self, name: str) -> float | None:
        """Return the value of a figure, if the board has it."""
        return self.figures.get(name)

    def figure(self, name: str) -> Figure:
        """Return a figure; one that the board lacks has the value None."""
        return _figure(self, name, UNITS)

    def check(self, name: str) -> Check | None:
        """Return the check of a name, if it ran."""
        return next((check for check in self.checks if check.name == name), None)


def decisive_reason(verdict: Verdict) -> str:
    """Return why a verdict is no pass; empty of a pass."""
    found = cause(verdict.checks)
    return "" if found is None else found.text


def channels_of(measurements: Measurements) -> tuple[Channel, ...]:
    """Return the figures of all channels of a transient, without their equilibrium."""
    return tuple(map(Channel.of, measurements.channels))


def _channels(verdict: Verdict) -> tuple[Channel, ...]:
    volts, error = verdict.steady.values.tolist(), finite(_rest_error(verdict))
    bound = None if error is None else error * verdict.measurements.amplitude
    known = {} if verdict.poles.stable is True else WITHOUT_REST
    return tuple(
        Channel.of(channel, known | {"equilibrium": Figure(finite(value), "V", bound)})
        for channel, value in zip(verdict.measurements.channels, volts, strict=True)
    )


def three(
    found: Mapping[str, Figure],
) -> tuple[Bounds, Bounds, Bounds]:
    """Return values, bounds and alternatives by name."""
    values: Bounds = {name: figure.value for name, figure in found.items()}
    bounds: Bounds = {n: f.uncertainty for n, f in found.items() if f.uncertainty is not None}
    others: Bounds = {name: f.alternative for name, f in found.items() if f.fragile}
    return values, bounds, others


def _figure(source: Record | Channel, name: str, units: Mapping[str, str]) -> Figure:
    bound, other = source.uncertainties.get(name), source.alternatives.get(name)
    fragile = name in source.alternatives
    return Figure(source.figures.get(name), units.get(name, ""), bound, other, fragile)
