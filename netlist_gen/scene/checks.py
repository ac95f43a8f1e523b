"""The checks of a scene and their limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from taction.netlist_gen.scene.fields import (
    Count,
    Model,
    NonNegative,
    Positive,
    Real,
    Seconds,
    Volts,
)
from taction.system.reading_definitions import SETTLING_BAND, TIMES

AGREE = 1e-3  # of the step amplitude: how far the engines may differ where a scene says nothing
LONG = 0.1  # s; boards of op-amps settle in microseconds to milliseconds


def unitless_times(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield a question for each time of the checks that has no unit and is long for a board.

    Examples
    --------
    >>> print(*unitless_times({"checks": {"settling_time": 10}}))
    checks.settling_time = 10 has no unit and is 10 s; is that meant? '10us' is 10 microseconds
    """
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


class UpperLimit(Model):
    """A check whose plain value is its `max`: ``settling_time = "10us"``."""

    @model_validator(mode="before")
    @classmethod
    def _plain_value(cls, data: Any) -> Any:
        return {"max": data} if isinstance(data, str | int | float) else data

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Return the schema of the table, or of a plain value."""
        return {"anyOf": [{"type": "number"}, {"type": "string"}, handler(core)]}


class SteadyStateCheck(Model):
    """Final outputs against the reference, as a fraction of the step amplitude."""

    tolerance: Positive = 1e-3


class SettlingTimeCheck(UpperLimit):
    """Settling to ``±band`` (a fraction of the step amplitude) within `max`, not before `min`."""

    band: Annotated[Positive, Field(lt=1)] = SETTLING_BAND
    max: Seconds | None = None
    min: Seconds | None = None


class ExcursionCheck(UpperLimit):
    """Overshoot or undershoot as a fraction of the step amplitude."""

    max: NonNegative = Field(description="fraction of the step amplitude")


class RiseTimeCheck(UpperLimit):
    """10-90 % rise time of one channel, by default the middle channel."""

    max: Seconds | None = None
    min: Seconds | None = None
    channel: Count | None = None


class NoiseCheck(UpperLimit):
    """Output noise of every channel at rest, rms over all frequencies, V."""

    max: Volts


class StabilityCheck(Model):
    """`margin`: factor by which C can shrink until the board oscillates; 1: only stability."""

    margin: Annotated[Real, Field(ge=1)] = 1.0


class EnginesAgreeCheck(Model):
    """Largest difference between ngspice and the state-space engine, over all time.

    Without a tolerance, `AGREE` of the step amplitude, or `analysis.error` if that is larger.
    """

    tolerance: Positive | None = None

    @property
    def limit(self) -> float:
        """The tolerance, or its default."""
        return AGREE if self.tolerance is None else self.tolerance


class Checks(Model):
    """The checks of a verdict and their limits."""

    steady_state: SteadyStateCheck = SteadyStateCheck()
    settling_time: SettlingTimeCheck = SettlingTimeCheck()
    overshoot: ExcursionCheck | None = None
    undershoot: ExcursionCheck | None = None
    rise_time: RiseTimeCheck | None = None
    noise: NoiseCheck | None = None
    stability: StabilityCheck = StabilityCheck()
    engines_agree: EnginesAgreeCheck = EnginesAgreeCheck()
