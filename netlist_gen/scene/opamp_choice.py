"""`OpAmpChoice`: the op-amp of a scene."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, StrictBool, WithJsonSchema, model_validator
from pydantic_core import CoreSchema

from taction.netlist_gen.scene.fields import (
    Amps,
    AmpsOrZero,
    Count,
    CurrentDensityOrZero,
    FaradsOrZero,
    FileName,
    Hertz,
    Model,
    Ohms,
    OhmsOrZero,
    Positive,
    Real,
    SignedAmps,
    SignedVolts,
    VoltageDensityOrZero,
    Volts,
    VoltsOrZero,
    VoltsPerSecond,
)
from taction.netlist_gen.scene.open_tables import OPAMPS, OneOf


class OpAmpChoice(Model):
    """A preset, or a preset with some figures changed."""

    base: Annotated[str, OneOf(OPAMPS), WithJsonSchema({"type": "string"})] = "ua741"
    file: FileName | None = Field(
        None, description="an imported op-amp (`taction models import`), in the place of a preset"
    )
    level: Literal["auto", "small-signal", "large-signal"] = Field(
        "auto",
        description="of the macromodel; auto: with slew rate and swing, and with the largest output"
        " current, where the small-signal board exceeds 90 % of such a limit",
    )
    dc_gain: Positive | None = None
    gbw: Hertz | None = None
    second_pole: Hertz | None = None
    phase_margin: Annotated[Real, Field(gt=0, lt=90)] | None = Field(
        None, description="degrees, at unity gain; sets the second pole"
    )
    input_resistance: Ohms | None = None
    differential_capacitance: FaradsOrZero | None = None
    input_capacitance: FaradsOrZero | None = None
    output_resistance: OhmsOrZero | None = None
    slew_rate: VoltsPerSecond | None = Field(None, description="of the output")
    output_current: Amps | None = Field(None, description="largest, of either sign")
    saturation: VoltsOrZero | None = Field(
        None, description="least distance of the output from a supply voltage"
    )
    least_supply: VoltsOrZero | None = None
    most_supply: Volts | None = None
    voltage_noise: VoltageDensityOrZero | None = Field(None, description="of the input, white")
    current_noise: CurrentDensityOrZero | None = Field(None, description="of each input, white")
    supply_current: AmpsOrZero | None = Field(None, description="of one op-amp without load")
    channels_per_package: Count | None = Field(None, description="op-amps in one package")
    input_errors: StrictBool = Field(
        False,
        description="every op-amp has the offset voltage, input currents and common-mode error of"
        " its figures; without it only those that are given here",
    )
    offset_voltage: SignedVolts | None = Field(None, description="at the non-inverting input")
    bias_current: SignedAmps | None = Field(
        None, description="mean of the currents into both inputs"
    )
    offset_current: SignedAmps | None = Field(
        None, description="current into the non-inverting input less the other"
    )
    common_mode_rejection: Positive | None = Field(None, description="dB")

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, data: Any) -> Any:
        return {"base": data} if isinstance(data, str) else data

    @model_validator(mode="after")
    def _file_alone(self) -> OpAmpChoice:
        others = sorted(self.model_fields_set - {"file"})
        if self.file is not None and others:
            raise ValueError(f"'file' excludes {others[0]!r}: an imported op-amp is as measured")
        return self

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        table = handler(core)
        return {"anyOf": [{"type": "string", "enum": list(OPAMPS)}, table]}
