"""The documents of ``taction models`` and its commands."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from taction.verification.report.schemas.shared import Document, Number, Part


class Preset(Part):
    """The figures of a preset; null or 0: the part has none."""

    dc_gain: Number
    gbw: Number
    second_pole: Number
    input_resistance: Number
    differential_capacitance: Number
    input_capacitance: Number
    output_resistance: Number
    slew_rate: Number
    output_current: Number
    saturation: Number
    least_supply: Number
    most_supply: Number
    voltage_noise: Number
    current_noise: Number
    supply_current: Number
    channels_per_package: int
    offset_voltage: Number
    bias_current: Number
    offset_current: Number
    common_mode_rejection: Number
    source: str


class ModelsDocument(Document):
    """``taction models``: the figures of each preset, by its name."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Preset] = Field(init=False)


class Figure(Part):
    """A figure of a data sheet."""

    value: Number
    unit: str
    note: str = Field(description="what the sheet says beside it, or how it was derived")


class Measured(Part):
    """A figure as stated and as measured on the test benches of each engine."""

    unit: str
    stated: Number
    state_space: Number = Field(None, alias="state space")
    ngspice: Number = None


class ShowDocument(Document):
    """``taction models show``: one op-amp."""

    name: str
    source: str
    external_part: str
    figures: dict[str, Figure]
    supply: Number = Field(description="of the test benches, both voltages")
    measured: dict[str, Measured] = Field(description="by the name of the figure")


class ImportedFigures(Part):
    """What the simulation of an imported op-amp shows; phase margin in degrees."""

    dc_gain: Number
    unity_gain_bandwidth: Number
    phase_margin: Number
    output_resistance: Number
    supply_current: Number


class Rational(Part):
    """``constant + sum residues / (s - poles)``: pairs of real and imaginary part, 1/s."""

    constant: Number
    poles: list[list[Number]]
    residues: list[list[Number]]


class LinearModel(Part):
    """The small-signal model; `error` is relative, over the `band` in Hz."""

    gain: Rational
    impedance: Rational
    conductance: Number
    capacitance: Number
    offset: Number
    rest: Number
    bias_current: Number
    error: Number
    band: list[Number]


class ImportDocument(Document):
    """``taction models import``: `file` is the file that was written."""

    file: str
    taction_opamp: int = Field(description="version of the format of the file")
    name: str
    subcircuit: str
    pins: list[str]
    supply: Number
    figures: ImportedFigures
    linear: LinearModel | None
    missing: str = Field(description="why there is no linear model")
