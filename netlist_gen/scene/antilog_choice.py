"""`AntilogChoice`: how the exponential amplifiers of a scene are built."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from taction.netlist_gen.scene.fields import Amps, Model, Ohms, Real
from taction.spice_models.transistor import NOMINAL, pair_names

STAGES = ("ideal", "device")
Celsius = Annotated[Real, Field(ge=-55, le=125)]


class AntilogChoice(Model):
    """An ideal function, or a matched pair of transistors with two op-amps."""

    stage: Literal["ideal", "device"] = "ideal"
    transistors: str = Field("ssm2220", description="the matched pair of a stage")
    reference_current: Amps = Field(1e-4, description="collector current at an output of U0")
    divider_resistance: Ohms = Field(100.0, description="from the divided input to ground")
    emitter_resistance: Ohms = Field(5e3, description="from the reference op-amp to the emitters")
    temperature: Celsius = Field(NOMINAL, description="of the transistors, degrees C")
    nominal_temperature: Celsius = Field(
        NOMINAL, description="for which the input divider is computed, degrees C"
    )

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, data: Any) -> Any:
        return {"stage": data} if isinstance(data, str) else data

    @model_validator(mode="after")
    def _known_pair(self) -> AntilogChoice:
        if self.transistors not in pair_names():
            known = ", ".join(map(repr, pair_names()))
            raise ValueError(f"transistors = {self.transistors!r}: unknown pair; one of {known}")
        return self

    @property
    def has_devices(self) -> bool:
        """Whether the stages are built from transistors."""
        return self.stage == "device"

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        table = handler(core)
        return {"anyOf": [{"type": "string", "enum": list(STAGES)}, table]}
