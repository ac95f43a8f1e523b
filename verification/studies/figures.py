"""The figures of a verdict: names, units, and functions that read them.

Documents, databases, baselines and yields all use these two tables. A figure that a verdict does
not have, or that is not finite, is None.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from taction.system.array_types import Floats
from taction.system.reading_definitions import READINGS
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.verdict.verify import Verdict

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Figure(Generic[T]):
    """One figure of a verdict or of a channel."""

    unit: str  # SI, "step" for fractions of the step amplitude, or empty for a plain number
    read: Callable[[T], Reading | float | None]

    def of(self, source: T) -> float | None:
        """Return the figure as a finite number, or None."""
        return finite(self.read(source))


def _of_network(name: str) -> Callable[[Verdict], Reading | None]:
    return lambda verdict: verdict.measurements.readings[name]


def _of_channel(name: str) -> Callable[[ChannelMeasure], Reading | None]:
    return lambda channel: channel.readings[name]


FIGURES: dict[str, Figure[Verdict]] = {
    **{name: Figure(kind.unit, _of_network(name)) for name, kind in READINGS.items()},
    "steady_state_error": Figure("step", lambda v: max(map(abs, signed_errors(v)))),
    "end_error": Figure("step", lambda v: max(map(abs, _relative(v, v.u[-1])))),
    "growth_rate": Figure("1/s", lambda v: v.poles.rightmost.real),
    "frequency": Figure("Hz", lambda v: abs(v.poles.rightmost.imag) / (2.0 * math.pi)),
    "damping_ratio": Figure("", lambda v: v.poles.damping_ratio),
    "margin": Figure("", lambda v: None if v.margin is None else v.margin.factor),
    "noise": Figure("V", lambda v: None if v.noise is None else v.noise.known),
    "step_amplitude": Figure("V", lambda v: v.measurements.amplitude),
    "lambda": Figure("", lambda v: v.circuit.value("lambda")),
    "resistance": Figure("ohm", lambda v: v.circuit.value("R")),
    "simulation_error": Figure("step", lambda v: v.error.steady_state),
    "seconds": Figure("s", lambda v: v.timing["total"]),
}
"""Figures of the whole board; the worst channel counts."""

TRANSIENT_READINGS = (*READINGS, "end_error")
POLE_READINGS = ("growth_rate", "frequency", "damping_ratio", "margin")
"""Figures that say how a board behaves; the others follow from the design or from the run."""

CHANNEL_FIGURES: dict[str, Figure[ChannelMeasure]] = {
    "target": Figure("V", lambda c: c.target),
    "final": Figure("V", lambda c: c.final),
    **{name: Figure(kind.unit, _of_channel(name)) for name, kind in READINGS.items()},
    "frequency": Figure("Hz", lambda c: c.frequency),
    "growth_rate": Figure("1/s", lambda c: c.growth_rate),
}
"""Figures of one channel."""


def figures_of(source: T, table: Mapping[str, Figure[T]]) -> dict[str, float | None]:
    """Return every figure of `table` that a verdict, or a channel, has."""
    return {name: figure.of(source) for name, figure in table.items()}


def readings_of(verdict: Verdict) -> dict[str, Reading | None]:
    """Return `TRANSIENT_READINGS` with their whole uncertainty; None for a missing reading."""
    value = FIGURES["end_error"].of(verdict)
    error = verdict.error.steady_state + verdict.ideal.error
    end = None if value is None else Reading(value, error)
    return {**verdict.measurements.readings, "end_error": end}


def signed_errors(verdict: Verdict) -> tuple[float, ...]:
    """Return equilibrium minus reference of every channel, fractions of the step amplitude."""
    return tuple(_relative(verdict, verdict.steady.values))


def _relative(verdict: Verdict, u: Floats) -> list[float]:
    """Return outputs (N,), V, minus the reference, fractions of the step amplitude."""
    amplitude = verdict.measurements.amplitude or math.nan
    return [float(off) / amplitude for off in u - verdict.ideal.target]


def finite(value: Reading | float | None) -> float | None:
    """Return a number, or the value of a reading, where it is finite."""
    if isinstance(value, Reading):
        value = value.value
    return float(value) if value is not None and math.isfinite(value) else None
