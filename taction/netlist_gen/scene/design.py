"""The board of a scene: op-amp, antilog stages, components, wires and devices of its arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from taction.netlist_gen.scene import fields
from taction.netlist_gen.scene.fields import entry, optional
from taction.netlist_gen.scene.open_tables import AMPLIFIERS, NAMES
from taction.spice_models.input_errors import ROOM, Surroundings
from taction.spice_models.transistor import NOMINAL, load_pairs
from taction.system.errors import listed
from taction.system.plugins import names


class WiresTable(fields.Model):
    """Resistances between the entries of an array and its op-amps; 0: none."""

    word_line: fields.OhmsOrZero = entry(0.0, "per pitch of the line of a row of T")
    bit_line: fields.OhmsOrZero = entry(0.0, "per pitch of the line of a column of T")
    driver: fields.OhmsOrZero = entry(0.0, "from the output of an op-amp to a line it drives")
    sense: fields.OhmsOrZero = entry(0.0, "from a line to the input that takes its current")
    corner: Literal["top-left", "top-right", "bottom-left", "bottom-right"] = entry(
        "top-left", "where the ports of rows and columns are; row 1 is at the top"
    )
    compensate: fields.Flag = entry(False, "scale resistors: T at the ports, as far as possible")

    @property
    def ideal(self) -> bool:
        """Whether no wire has a resistance."""
        return not (self.word_line or self.bit_line or self.driver or self.sense)


Share = Annotated[fields.Real, Field(ge=0, lt=1)]
Levels = Annotated[int, Field(strict=True, ge=2, le=65536)]


Cell = Literal["rram-wan", "rram-milo", "pcm-joshi", "pcm-aihwkit"]


class DevicesTable(fields.Model):
    """Devices in the place of the arrays' resistors; without any key there are resistors."""

    cell: Cell | None = optional("a device by its name, whose figures hold")
    least_conductance: fields.Siemens | None = optional("a smaller entry of T has this one")
    most_conductance: fields.Siemens | None = optional("a larger entry of T has this one")
    cell_levels: Levels | None = optional("evenly spaced conductances; or the cell's, or any")
    programming_error: fields.Siemens | None = optional("sigma after programming; or the cell's")
    read_noise: Share | None = optional("sigma from solve to solve, a fraction")
    drift_exponent: fields.NonNegative | None = optional("nu of g (t/t0)^-nu; or the cell's")
    drift_spread: fields.NonNegative | None = optional("sigma of nu among the devices")
    drift_start: fields.Seconds | None = optional("t0 since programming; or the cell's, or 1 s")
    age: fields.Seconds | None = optional("t since programming; by default nothing has drifted")
    stuck_at_least: Share | None = optional("fraction of the cells at the least conductance")
    stuck_at_most: Share | None = optional("fraction of the cells at the most conductance")


Celsius = Annotated[fields.Real, Field(ge=-55, le=125)]


class AntilogChoice(fields.Shortened):
    """An ideal function, or a matched pair of transistors with two op-amps."""

    PLAIN = "stage"

    stage: Literal["ideal", "device"] = "ideal"
    transistors: str = entry("ssm2220", "the matched pair of a stage")
    reference_current: fields.Amps = entry(1e-4, "collector current at an output of U0")
    divider_resistance: fields.Ohms = entry(100.0, "from the divided input to ground")
    emitter_resistance: fields.Ohms = entry(5e3, "from the reference op-amp to the emitters")
    temperature: Celsius = entry(NOMINAL, "of the transistors, degrees C")
    nominal_temperature: Celsius = entry(NOMINAL, "of the computed input divider, degrees C")

    @model_validator(mode="after")
    def _known_pair(self) -> AntilogChoice:
        if self.transistors not in load_pairs():
            known = ", ".join(map(repr, load_pairs()))
            raise ValueError(f"transistors = {self.transistors!r}: unknown pair; one of {known}")
        return self

    @property
    def has_devices(self) -> bool:
        """Whether the stages are built from transistors."""
        return self.stage == "device"


def _level(value: object) -> object:
    """Return a level of the input errors; true and false stand for the first and the last."""
    return {True: "typical", False: "none"}[value] if isinstance(value, bool) else value


InputErrors = Annotated[
    Literal["typical", "max", "none"],
    BeforeValidator(_level),
    WithJsonSchema({"enum": ["typical", "max", "none", True, False]}),
]


class OpAmpChoice(fields.Shortened):
    """A preset, or a preset with some figures changed."""

    PLAIN = "base"

    base: Annotated[str, NAMES["op-amp"]] = "ua741"
    file: fields.FileName | None = optional("an imported op-amp, in the place of a preset")
    model: Literal["cards", "figures"] = entry(
        "cards", "of an imported op-amp: its own cards, or a macromodel of its figures"
    )
    level: Literal["auto", "small-signal", "large-signal"] = entry(
        "auto", "of the macromodel; auto: large-signal where the board exceeds 90 % of a limit"
    )
    dc_gain: fields.Positive | None = None
    gbw: fields.Hertz | None = None
    second_pole: fields.Hertz | None = None
    phase_margin: Annotated[fields.Real, Field(gt=0, lt=90)] | None = optional(
        "degrees, at unity gain; sets the second pole"
    )
    input_resistance: fields.Ohms | None = None
    differential_capacitance: fields.FaradsOrZero | None = None
    input_capacitance: fields.FaradsOrZero | None = None
    output_resistance: fields.OhmsOrZero | None = None
    slew_rate: fields.VoltsPerSecond | None = optional("of the output")
    output_current: fields.Amps | None = optional("largest, of either sign")
    saturation: fields.VoltsOrZero | None = optional("least distance of the output from a supply")
    least_supply: fields.VoltsOrZero | None = None
    most_supply: fields.Volts | None = None
    voltage_noise: fields.VoltageDensityOrZero | None = optional("of the input, white")
    current_noise: fields.CurrentDensityOrZero | None = optional("of each input, white")
    voltage_noise_corner: fields.HertzOrZero | None = optional("below it 1/f noise is larger")
    supply_current: fields.AmpsOrZero | None = optional("of one op-amp without load")
    channels_per_package: fields.Count | None = optional("op-amps in one package")
    input_errors: InputErrors = entry(
        "typical", "sizes of offset and input currents on its sheet; none: those given here"
    )
    offset_voltage: fields.SignedVolts | None = optional("at the non-inverting input")
    bias_current: fields.SignedAmps | None = optional("mean of the currents into both inputs")
    offset_current: fields.SignedAmps | None = optional("into the + input less the other")
    common_mode_rejection: fields.Positive | None = optional("dB")
    offset_drift: fields.VoltsPerKelvinOrZero | None = optional("typical; with design.temperature")
    bias_drift: fields.AmpsPerKelvinOrZero | None = optional("typical; with design.temperature")
    bias_doubling: fields.Kelvins | None = optional("warming that doubles the input currents")
    supply_rejection: fields.Positive | None = optional("dB; with design.supply_tolerance")

    @model_validator(mode="after")
    def _file_alone(self) -> OpAmpChoice:
        others = sorted(self.model_fields_set - {"file", "model"})
        if self.file is None and self.model == "figures":
            raise ValueError("'model' is of an imported op-amp; expected 'file' beside it")
        if self.file is not None and others:
            raise ValueError(f"'file' excludes {others[0]!r}: an imported op-amp is as measured")
        return self


class Design(fields.Model):
    """The board's components."""

    topology: Annotated[str, NAMES["topology"]] = "integrator"
    amplifier: Annotated[str, NAMES["amplifier"]] = "linear"
    capacitance: fields.Farads = 1e-11
    resistance: fields.Ohms | None = None
    lam: fields.LambdaOrRule | None = Field(
        None, alias="lambda", description="regularisation parameter, or the rule that chooses it"
    )
    gain: fields.Ohms = 6.252e6
    feedback_conductance: fields.Siemens | None = optional(
        "gf of the first stages of a closed-loop board; by default unit_conductance"
    )
    negative_entries: Literal["inverters", "differential", "offset"] = entry(
        "inverters", "of a closed-loop board: inverters, the other inputs, or one offset column"
    )
    unit_conductance: fields.Siemens = 3.313e-7
    unit_voltage: fields.Volts = 1.0
    exponential_slope: fields.Volts | None = None
    bias: fields.Flag | None = optional("bias current I_b = Ve/R")
    ridge_share: Annotated[fields.Real, Field(ge=0, le=1)] = entry(
        1.0, "of deadzone, rectifier and saturation: the share of sum u^2/2 that stays"
    )
    antilog: AntilogChoice = entry(AntilogChoice(), "exponential amplifiers: how they are built")
    opamp: OpAmpChoice = OpAmpChoice()
    supply: fields.SupplyVolts = entry(15.0, "both supply voltages of the op-amps, as '±15V'")
    temperature: fields.TwoTemperatures | None = optional(
        "at which the board must work; drift from 25 degrees C counts in steady_state"
    )
    supply_tolerance: Annotated[fields.Real, Field(ge=0, lt=1)] = entry(
        0.0, "fraction of the supply voltages; supply rejection counts, as temperature"
    )
    temperature_coefficient: fields.NonNegative = entry(0.0, "per K, the largest of a resistor")
    stray_capacitance: fields.FaradsOrZero = 1e-11
    sensor_noise: fields.CurrentDensityOrZero = entry(0.0, "of every strain, white")
    strain_input: Literal["current", "voltage"] = entry(
        "current", "of every strain: a current, or eps U0 through a resistor 1/G0"
    )
    inverter_resistance: fields.Ohms = 1e4
    prune: Annotated[fields.Real, Field(ge=0, lt=1)] = entry(
        0.0, "entries of T below this fraction of the largest have no resistors"
    )
    resistor_series: Literal["exact", "E24", "E96", "E192"] = "exact"
    capacitor_series: Literal["exact", "E6", "E12", "E24"] = entry("exact", "of C alone")

    @property
    def surroundings(self) -> Surroundings:
        """Temperatures and supply voltages at which the board must work."""
        match = None if self.temperature is None else fields.RANGE.fullmatch(self.temperature)
        ends = (ROOM, ROOM) if match is None else tuple(map(float, match.groups()))
        volts = self.supply_tolerance * self.supply
        return Surroundings(min(ends[0] - ROOM, 0.0), max(ends[1] - ROOM, 0.0), volts)

    @property
    def biased(self) -> bool:
        """Whether a bias current flows, by the scene or by the default of the amplifier."""
        return AMPLIFIERS[self.amplifier].biased if self.bias is None else self.bias


def contradictions(design: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield each key of a design that contradicts another key, with the reason."""
    if design.get("lambda") is not None and design.get("resistance") is not None:
        yield "lambda", "excludes 'resistance': give one of the two"
    if design.get("amplifier", "linear") == "linear":
        for key in ("exponential_slope", "bias"):
            if design.get(key) is not None:
                yield key, "needs a nonlinear amplifier, such as 'exponential'"
    if design.get("ridge_share", 1.0) != 1.0:
        kind = AMPLIFIERS.get(str(design.get("amplifier", "linear")))
        if not (kind and kind.ridge):
            accepted = listed(name for name, each in AMPLIFIERS.items() if each.ridge)
            yield "ridge_share", f"needs an amplifier whose ridge term can be removed: {accepted}"
    if design.get("temperature_coefficient") and design.get("temperature") is None:
        yield "temperature_coefficient", "needs temperature, such as '0..70degC'"
    for name, keys in design.items():
        other = isinstance(keys, Mapping) and name != design.get("topology")
        if other and name in names("taction.topologies"):
            yield name, f"needs topology = {name!r}"
    antilog = design.get("antilog")
    stage = antilog.get("stage", "ideal") if isinstance(antilog, Mapping) else antilog
    if stage == "device" and design.get("amplifier", "linear") != "exponential":
        yield "antilog", "'device' needs amplifier = 'exponential'"
