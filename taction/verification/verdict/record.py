"""A verdict as one flat record: outcome, figures, checks, channels.

Every study keeps records, never verdicts: a sweep a record a point, a yield a record a sample, a
baseline a record a scene. A verification that reached no verdict has a record, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Generic, TypeVar

from taction.system.array_types import Floats
from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict.checks import Check, Outcome, band_text, cause
from taction.verification.verdict.verify import Verdict

T = TypeVar("T")

ERROR = "error"
"""Outcome of a verification that reached no verdict."""
MAX_REASON = 4000  # characters
STATES = tuple(ChannelState)  # the best first; of several channels the worst state counts


def finite(value: Reading | float | None) -> float | None:
    """Return a number, or the value of a reading, where it is finite."""
    if isinstance(value, Reading):
        value = value.value
    return float(value) if value is not None and math.isfinite(value) else None


@dataclass(frozen=True, slots=True)
class Figure:
    """A number that a verdict states."""

    value: float | None  # None where the board has no such number
    unit: str = ""
    uncertainty: float | None = None  # bound on the error; None where it is unknown
    # Of a fragile time, which a small change of a level moves: its other value, None if missing.
    alternative: float | None = None
    fragile: bool = False


@dataclass(frozen=True, slots=True)
class FigureRule(Generic[T]):
    """How a figure is read from a verdict or from a channel."""

    unit: str  # SI, "step" for fractions of the step amplitude, or empty for a plain number
    read: Callable[[T], Reading | float | None]
    error: Callable[[T], float | None] = lambda source: None  # bound; of a `Reading` its own

    def figure(self, source: T) -> Figure:
        """Return the figure; its value is None where the source has none."""
        found = self.read(source)
        value = finite(found)
        if value is None:
            return Figure(None, self.unit)
        if isinstance(found, Reading):
            bound, other = finite(found.uncertainty), found.alternative
            return Figure(value, self.unit, bound, other, fragile=found.fragile)
        return Figure(value, self.unit, finite(self.error(source)))


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


def _reading(name: str) -> Callable[[Any], Reading | None]:
    """Return what reads a reading of the network, or of a channel."""
    return lambda source: getattr(source, "measurements", source).readings[name]


FIGURES: dict[str, FigureRule[Verdict]] = {
    **{name: FigureRule(kind.unit, _reading(name)) for name, kind in READINGS.items()},
    "steady_state_error": FigureRule(
        "step", lambda v: max(map(abs, signed_errors(v))), _rest_error
    ),
    "end_error": FigureRule(
        "step",
        lambda v: max(map(abs, _relative(v, v.run.first_and_last[-1]))),
        lambda v: v.end_error + v.ideal.error,
    ),
    "growth_rate": FigureRule(
        "1/s", lambda v: v.poles.rightmost.real, lambda v: v.poles.resolution
    ),
    "frequency": FigureRule(
        "Hz",
        lambda v: abs(v.poles.rightmost.imag) / math.tau,
        lambda v: v.poles.resolution / math.tau,
    ),
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
    "simulation_error": FigureRule("step", lambda v: v.end_error),
    "seconds": FigureRule("s", lambda v: v.timing["total"]),
}
"""Figures of the whole board; the worst channel counts."""

POLE_READINGS = ("growth_rate", "frequency", "damping_ratio", "margin")
"""Figures that say how a board behaves; the others follow from the design or from the run."""

CHANNEL_FIGURES: dict[str, FigureRule[ChannelMeasure]] = {
    "reference": FigureRule("V", lambda c: c.target),
    "final": FigureRule("V", lambda c: c.final),
    **{name: FigureRule(kind.unit, _reading(name)) for name, kind in READINGS.items()},
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
    figures: Annotated[dict[str, float | None], {"inline": CHANNEL_UNITS}]
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
    engine: str  # ``"ngspice"`` or ``"statespace"``
    simulator: str | None = None  # the same with its version; None without a verdict
    failure: str | None = None  # name of the exception that ended the verification
    reason: str = ""  # why the outcome is not pass
    state: str | None = None  # state of the worst channel at the end of the record
    stable: bool | None = None
    # By the names in `FIGURES`; None where the board has no such figure.
    figures: Annotated[dict[str, float | None], {"inline": UNITS}] = field(default_factory=dict)
    uncertainties: Bounds = field(default_factory=dict)  # bounds on their errors; None: infinite
    alternatives: Bounds = field(default_factory=dict)  # the other values of fragile times, s
    checks: tuple[Check, ...] = ()
    channels: tuple[Channel, ...] = ()

    @classmethod
    def of(cls, verdict: Verdict, *, channels: bool = True) -> Record:
        """Return the record of a verdict; without `channels` only of the whole board."""
        engine, decisive = verdict.run.ends.engine, cause(verdict.checks)
        known = {} if verdict.poles.stable is True else WITHOUT_REST
        found = {name: rule.figure(verdict) for name, rule in FIGURES.items()} | known
        measured, error = verdict.measurements, finite(_rest_error(verdict))
        bound = None if error is None else error * measured.amplitude
        rest = (Figure(finite(volts), "V", bound) for volts in verdict.steady.values.tolist())
        each = (
            Channel.of(channel, known | {"equilibrium": figure})
            for channel, figure in zip(measured.channels, rest, strict=True)
        )
        state = max((c.state for c in measured.channels), key=STATES.index)
        return cls(
            verdict.outcome.value,
            engine.partition("-")[0],
            engine,
            None,
            "" if decisive is None else decisive.text,
            state.value,
            verdict.poles.stable,
            *three(found),
            verdict.checks,
            tuple(each) if channels else (),
        )

    @classmethod
    def without_verdict(cls, error: BaseException, engine: str, reason: str = "") -> Record:
        """Return the record of a verification that an exception ended, by default with its text."""
        text, figures = (reason or str(error))[:MAX_REASON], dict.fromkeys(FIGURES)
        return cls(ERROR, engine, failure=type(error).__name__, reason=text, figures=figures)

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

    @property
    def check_values(self) -> dict[str, float | None]:
        """The values of the checks that ran."""
        return {check.name: check.value for check in self.checks}


def three(found: Mapping[str, Figure]) -> tuple[Bounds, Bounds, Bounds]:
    """Return values, bounds and alternatives by name."""
    values: Bounds = {name: figure.value for name, figure in found.items()}
    bounds: Bounds = {n: f.uncertainty for n, f in found.items() if f.uncertainty is not None}
    others: Bounds = {name: f.alternative for name, f in found.items() if f.fragile}
    return values, bounds, others


def _figure(source: Record | Channel, name: str, units: Mapping[str, str]) -> Figure:
    bound, other = source.uncertainties.get(name), source.alternatives.get(name)
    fragile = name in source.alternatives
    return Figure(source.figures.get(name), units.get(name, ""), bound, other, fragile)


Group = str
"""``"outcome"``, ``"checks"`` and ``"states"`` are words, ``"values"`` are those of checks,
``"figures"`` of the board, ``"channels"`` of one output, ``"waveforms"`` norms of outputs."""
GROUPS: tuple[Group, ...] = ("outcome", "checks", "values", "states", "figures", "channels")


@dataclass(frozen=True, slots=True)
class Difference:
    """One quantity of two records."""

    SHOWN: ClassVar[tuple[str, ...]] = ("beyond",)

    group: Group
    name: str
    channel: int | None  # from 1; None for a quantity of the board
    first: float | str | None  # the quantity in `unit`, or a word; None where there is none
    second: float | str | None
    unit: str
    difference: float | None  # second minus first; None where one of them is no number
    allowed: float | None  # of the difference; None: unknown, or both must be equal
    # Difference over what is allowed; infinite without a comparison, NaN if `allowed` is unknown.
    off: float
    note: str = ""  # such as where it is largest; of a settling time its bands

    @property
    def label(self) -> str:
        """What is compared, in words: ``"check stability"``, ``"u_1.final"``."""
        if self.group in ("checks", "waveforms"):
            return f"{self.group.removesuffix('s')} {self.name}"
        if self.channel is None:
            return self.name
        node = f"u_{self.channel}"
        return f"state {node}" if self.group == "states" else f"{node}.{self.name}"

    @property
    def beyond(self) -> bool | None:
        """Whether the difference is larger than what is allowed; None where that is unknown."""
        return None if math.isnan(self.off) else not self.off <= 1.0


Tolerance = Callable[[str, Figure, Figure], float | None]
"""Of a quantity's name, its value in both records: the allowed difference; None: unknown."""


def within_uncertainties(name: str, first: Figure, second: Figure) -> float | None:
    """Return the sum of both uncertainties, which are bounds; None if one is unknown."""
    if first.uncertainty is None or second.uncertainty is None:
        return None
    return first.uncertainty + second.uncertainty


Row = tuple[Group, str, int | None]
"""Group, name and channel of a quantity."""


def compare(
    first: Record,
    second: Record,
    tolerance: Tolerance,
    *,
    groups: Collection[Group] = GROUPS,
    figures: Sequence[str] = tuple(FIGURES),
    channel_figures: Sequence[str] = (*CHANNEL_FIGURES, "equilibrium"),
) -> tuple[Difference, ...]:
    """Compare every quantity of the `groups` and `figures` that either record has.

    A word must be equal. Of a fragile time the nearest of its two values counts. `tolerance` gives
    the difference that is allowed.
    """
    one, two = (dict(_rows(each, figures, channel_figures)) for each in (first, second))
    texts = ("".join(map(band_text, record.checks)) for record in (first, second))
    known = [*dict.fromkeys(filter(None, texts))]
    bands = "A {}, B {}".format(*known) if len(known) > 1 else "".join(known)
    return tuple(
        _difference(row, one.get(row), two.get(row), tolerance, bands * (row[1] == "settling_time"))
        for row in {**one, **two}
        if row[0] in groups
    )


def _difference(
    row: Row,
    first: Figure | str | None,
    second: Figure | str | None,
    tolerance: Tolerance,
    note: str,
) -> Difference:
    """Return the difference of two words, or of two numbers, of fragile ones the nearest values."""
    if isinstance(first, str) or isinstance(second, str):
        one, two = (None if each is None else str(each) for each in (first, second))
        return Difference(*row, one, two, "", None, None, 0.0 if one == two else math.inf)
    a, b = first or Figure(None), second or Figure(None)
    if a.value is not None and b.value is not None and a.unit != b.unit:  # a rate, and a margin
        words = (show(a.value, a.unit), show(b.value, b.unit))
        return Difference(*row, *words, "", None, None, math.inf)
    made = Difference(*row, a.value, b.value, a.unit or b.unit, None, None, math.inf, note)
    if a.value is None or b.value is None:
        same = all(x.value is None or (x.fragile and x.alternative is None) for x in (a, b))
        return replace(made, off=0.0) if same else made
    others = [(a.value, b.alternative), (a.alternative, b.value)]
    pairs = [(a.value, b.value), *((x, y) for x, y in others if x is not None and y is not None)]
    x, y = min(pairs, key=lambda pair: abs(pair[1] - pair[0]))
    allowed = tolerance(row[1], a, b)
    off = relative(abs(y - x), allowed)
    return replace(made, first=x, second=y, difference=y - x, allowed=allowed, off=off)


def _rows(
    record: Record, figures: Sequence[str], channel_figures: Sequence[str]
) -> Iterator[tuple[Row, Figure | str]]:
    """Yield every quantity of a record: a word, or a figure; no figure that it lacks."""
    yield ("outcome", "outcome", None), record.outcome
    for check in record.checks:
        yield ("checks", check.name, None), check.outcome.value
        value = Figure(finite(check.value), check.unit, finite(check.uncertainty))
        yield ("values", check.name, None), value
    for name in figures:
        if (figure := record.figure(name)).value is not None:
            yield ("figures", name, None), figure
    for channel in record.channels:
        yield ("states", "state", channel.index), channel.state
        for name in channel_figures:
            if (figure := channel.figure(name)).value is not None:
                yield ("channels", name, channel.index), figure


def relative(distance: float, allowed: float | None) -> float:
    """Return a distance over what is allowed; a distance of 0 is always allowed."""
    if distance == 0.0:
        return 0.0
    if allowed is None:
        return math.nan
    return distance / allowed if allowed > 0.0 else math.inf
