"""Types of a scene's fields: quantities with units and plain numbers; the base of the tables."""

from __future__ import annotations

from typing import Annotated, Literal

from taction.netlist_gen.scene.field_values import Number, Rule, ShortText, Unit
from taction.netlist_gen.scene.model import Model, field

__all__ = ["Model", "field"]  # what a table of another package needs stands here

MOST_CHANNELS = 5000  # T has 0.2 GB, and the analysis of the board takes many times that

Farads = Annotated[float, Unit("F")]
FaradsOrZero = Annotated[float, Unit("F", zero=True)]
Ohms = Annotated[float, Unit("ohm")]
OhmsOrZero = Annotated[float, Unit("ohm", zero=True)]
Siemens = Annotated[float, Unit("S")]
Volts = Annotated[float, Unit("V")]
VoltsOrZero = Annotated[float, Unit("V", zero=True)]
SignedVolts = Annotated[float, Unit("V", signed=True)]
SupplyVolts = Annotated[float, Unit("V", both=True)]
Amps = Annotated[float, Unit("A")]
SignedAmps = Annotated[float, Unit("A", signed=True)]
AmpsOrZero = Annotated[float, Unit("A", zero=True)]
Kelvins = Annotated[float, Unit("K")]
VoltsPerKelvinOrZero = Annotated[float, Unit("V/K", zero=True)]
AmpsPerKelvinOrZero = Annotated[float, Unit("A/K", zero=True)]
VoltsPerSecond = Annotated[float, Unit("V/s")]
VoltageDensityOrZero = Annotated[float, Unit("V/rtHz", zero=True)]
CurrentDensityOrZero = Annotated[float, Unit("A/rtHz", zero=True)]
Hertz = Annotated[float, Unit("Hz")]
HertzOrZero = Annotated[float, Unit("Hz", zero=True)]
Seconds = Annotated[float, Unit("s")]
SecondsOrAuto = Annotated[Literal["auto"] | float, Unit("s", word="auto")]
LambdaOrRule = Annotated[
    float | str, Rule(("discrepancy", "gcv", "l-curve", "quasi-optimality", "mse"))
]

Real = Annotated[float, Number()]
Positive = Annotated[float, Number(gt=0)]
NonNegative = Annotated[float, Number(ge=0)]
Count = Annotated[int, Number(ge=1, le=MOST_CHANNELS, whole=True)]
Seed = Annotated[int, Number(ge=0, whole=True)]
FileName = Annotated[str, ShortText(least=1)]
