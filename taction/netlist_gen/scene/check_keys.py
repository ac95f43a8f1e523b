"""The scene's tables of limits: ``[checks]``, ``[tolerances]`` of parts, and ``[regression]``.

A difference from a stored result is accepted up to ``absolute + relative |baseline|``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo

from taction.netlist_gen.scene import fields
from taction.netlist_gen.scene.fields import entry
from taction.system.quantities import show
from taction.system.reading_definitions import SETTLING_BAND, TIMES

LOWEST = 0.1  # Hz; data sheets print the 1/f noise from here to 10 Hz
AGREE = 1e-3  # of the step amplitude: how far the engines may differ where a scene says nothing
LONG = 0.1  # s; boards of op-amps settle in microseconds to milliseconds


def unitless_times(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield a question for each time of the checks that has no unit and is long for a board."""
    checks = data.get("checks")
    for name in TIMES:
        check = checks.get(name) if isinstance(checks, Mapping) else None
        table = check if isinstance(check, Mapping) else {"": check}
        for key in ("", "max", "min"):
            value = table.get(key)
            if isinstance(value, int | float) and value >= LONG:
                path = f"checks.{name}.{key}".rstrip(".")
                yield (
                    f"{path} = {value:g} has no unit and is {value:g} s; is that meant?"
                    f" '{value:g}us' is {value:g} microseconds"
                )


class UpperLimit(fields.Shortened):
    """A check whose plain value is its `max`."""

    PLAIN = "max"


class SteadyStateCheck(fields.Model):
    """Final outputs against the reference, as a fraction of the step amplitude."""

    tolerance: Annotated[fields.Positive, Field(lt=1)] = 1e-3


def _below_max(least: float | None, info: ValidationInfo) -> float | None:
    """Return `min` if it is not above `max`: nothing would pass."""
    most = info.data.get("max")
    if least is not None and most is not None and least > most:
        shown = show(most, "s")
        text = f"above max = {shown}, so nothing passes; expected at most {shown}"
        raise ValueError(f"{text}, or are they swapped?")
    return least


Least = Annotated[fields.Seconds | None, AfterValidator(_below_max)]


class SettlingTimeCheck(UpperLimit):
    """Settling to ``±band`` (a fraction of the step amplitude) within `max`, not before `min`."""

    band: Annotated[fields.Positive, Field(lt=1)] = SETTLING_BAND
    max: fields.Seconds | None = None
    min: Least = None


class ExcursionCheck(UpperLimit):
    """Overshoot or undershoot as a fraction of the step amplitude."""

    max: fields.NonNegative = Field(description="fraction of the step amplitude")


class RiseTimeCheck(UpperLimit):
    """10-90 % rise time of every channel whose own step is at least 5 % of A, or of `channel`."""

    max: fields.Seconds | None = None
    min: Least = None
    channel: fields.Count | None = entry(None, "from 1; by default every channel that rises")


class NoiseCheck(UpperLimit):
    """Output noise of every channel at rest, rms, V, over all frequencies or above the lowest."""

    max: fields.Volts = Field(description="largest noise of an output, rms, V")
    lowest: fields.Hertz | None = entry(
        None,
        f"lowest frequency that counts; by default {LOWEST:g} Hz where there is 1/f noise, else 0",
    )


class StabilityCheck(fields.Model):
    """`margin`: factor by which C can shrink until the board oscillates; 1: only stability."""

    margin: Annotated[fields.Real, Field(ge=1)] = 1.0


class EnginesAgreeCheck(fields.Model):
    """Largest difference between ngspice and the state-space engine, over all time.

    Without a tolerance, `AGREE` of the step amplitude, or `analysis.error` if that is larger.
    """

    tolerance: fields.Positive | None = None

    @property
    def limit(self) -> float:
        """The tolerance, or its default."""
        return AGREE if self.tolerance is None else self.tolerance


class Checks(fields.Model):
    """The checks of a verdict and their limits."""

    steady_state: SteadyStateCheck = SteadyStateCheck()
    settling_time: SettlingTimeCheck = SettlingTimeCheck()
    overshoot: ExcursionCheck | None = None
    undershoot: ExcursionCheck | None = None
    rise_time: RiseTimeCheck | None = None
    noise: NoiseCheck | None = None
    stability: StabilityCheck = StabilityCheck()
    engines_agree: EnginesAgreeCheck = EnginesAgreeCheck()


class Tolerances(fields.Model):
    """Tolerances of real components, fractions of their values."""

    distribution: Literal["normal", "uniform"] = entry(
        "normal", "a tolerance is 3 sigma, or the end"
    )
    resistor: fields.NonNegative = entry(0.01, "every resistor by itself")
    capacitor: fields.NonNegative = entry(0.05, "C of every signal node by itself")
    stray: fields.NonNegative = entry(0.2, "stray capacitance of every summing node")
    opamp_gbw: fields.NonNegative = entry(0.3, "gain-bandwidth product and second pole together")
    opamp_gain: fields.NonNegative = entry(0.5, "DC gain of every op-amp")
    parts: dict[str, fields.NonNegative] = entry({}, "of single parts: { Rf_4_4 = 0.001 }")
    temperature: fields.NonNegative = entry(0.0, "K, either side of nominal; the whole board")
    resistor_drift: fields.Real = entry(1e-4, "per K")
    capacitor_drift: fields.Real = entry(3e-5, "per K")
    opamp_drift: fields.Real = entry(-3e-3, "of the gain-bandwidth product, per K")


class LevelTolerance(fields.Model):
    """Targets, finals, over- and undershoot; `absolute` is a fraction of the step amplitude."""

    relative: fields.NonNegative = 1e-3
    absolute: fields.NonNegative = 1e-4


class TimeTolerance(fields.Model):
    """Rise times and settling times."""

    relative: fields.NonNegative = 0.02
    absolute: Annotated[float, fields.Unit("s", zero=True)] = 0.0


class PoleTolerance(fields.Model):
    """Growth rate (1/s) and frequency (Hz) of the rightmost pole, and the stability margin.

    `absolute` is a fraction of the pole's magnitude: a double pole splits by half the digits.
    """

    relative: fields.NonNegative = 1e-3
    absolute: fields.NonNegative = 1e-6


class Regression(fields.Model):
    """Differences that `taction regress` accepts."""

    levels: LevelTolerance = LevelTolerance()
    times: TimeTolerance = TimeTolerance()
    poles: PoleTolerance = PoleTolerance()
