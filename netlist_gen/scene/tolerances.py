"""The scene's table ``[tolerances]``: tolerances of real components."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from taction.netlist_gen.scene.fields import Model, NonNegative, Real


class Tolerances(Model):
    """Tolerances of real components, fractions of their values."""

    distribution: Literal["normal", "uniform"] = Field(
        "normal", description="normal: the tolerance is three sigma; uniform: within it"
    )
    resistor: NonNegative = Field(0.01, description="every resistor by itself")
    capacitor: NonNegative = Field(0.05, description="C of every signal node by itself")
    stray: NonNegative = Field(0.2, description="stray capacitance of every summing node")
    opamp_gbw: NonNegative = Field(
        0.3, description="gain-bandwidth product and second pole of every op-amp together"
    )
    opamp_gain: NonNegative = Field(0.5, description="DC gain of every op-amp")
    parts: dict[str, NonNegative] = Field(
        {}, description="tolerances of single parts by their names in the deck: { Rf_4_4 = 0.001 }"
    )
    temperature: NonNegative = Field(0.0, description="K, either side of nominal; the whole board")
    resistor_drift: Real = Field(1e-4, description="per K")
    capacitor_drift: Real = Field(3e-5, description="per K")
    opamp_drift: Real = Field(-3e-3, description="of the gain-bandwidth product, per K")
