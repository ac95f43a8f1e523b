"""The board of a scene: op-amp, antilog stages, components."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from taction.netlist_gen.scene.field_values import RANGE, Number, TemperatureRange, Words
from taction.netlist_gen.scene.fields import (
    Amps,
    AmpsOrZero,
    AmpsPerKelvinOrZero,
    Count,
    CurrentDensityOrZero,
    Farads,
    FaradsOrZero,
    FileName,
    Hertz,
    HertzOrZero,
    Kelvins,
    LambdaOrRule,
    Model,
    NonNegative,
    Ohms,
    OhmsOrZero,
    Positive,
    Siemens,
    SignedAmps,
    SignedVolts,
    SupplyVolts,
    VoltageDensityOrZero,
    Volts,
    VoltsOrZero,
    VoltsPerKelvinOrZero,
    VoltsPerSecond,
    field,
)
from taction.netlist_gen.scene.model import value_text
from taction.netlist_gen.scene.open_tables import AMPLIFIERS, NAMES
from taction.spice_models.input_errors import ROOM, Surroundings
from taction.spice_models.transistor import NOMINAL, pair_names
from taction.system.errors import Complaint
from taction.system.plugins import names

Celsius = Annotated[float, Number(ge=-55, le=125)]


class AntilogChoice(Model):
    """An ideal function, or a matched pair of transistors with two op-amps."""

    PLAIN = "stage"

    stage: Literal["ideal", "device"] = "ideal"
    transistors: str = field("ssm2220", description="the matched pair of a stage")
    reference_current: Amps = field(1e-4, description="collector current at an output of U0")
    divider_resistance: Ohms = field(100.0, description="from the divided input to ground")
    emitter_resistance: Ohms = field(5e3, description="from the reference op-amp to the emitters")
    temperature: Celsius = field(NOMINAL, description="of the transistors, degrees C")
    nominal_temperature: Celsius = field(
        NOMINAL, description="for which the input divider is computed, degrees C"
    )

    def contradiction(self) -> str:
        """Return what is wrong with the name of the pair."""
        if self.transistors in (known := pair_names()):
            return ""
        names = ", ".join(map(repr, known))
        return f"transistors = {self.transistors!r}: unknown pair; one of {names}"

    @property
    def has_devices(self) -> bool:
        """Whether the stages are built from transistors."""
        return self.stage == "device"


class InputErrorLevel(Words):
    """Annotation of a level of the input errors; true and false stand for the first and none."""

    def check(self, value: object) -> str:
        """Return the level; ValueError has the accepted ones."""
        known = {True: "typical", False: "none"}[value] if isinstance(value, bool) else value
        return super().check(known)

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the values."""
        return {"enum": [*self.names, True, False]}


InputErrors = Annotated[
    Literal["typical", "max", "none"], InputErrorLevel(("typical", "max", "none"))
]


class OpAmpChoice(Model):
    """A preset, or a preset with some figures changed."""

    PLAIN = "base"

    base: Annotated[str, NAMES["op-amp"]] = "ua741"
    file: FileName | None = field(
        None, description="an imported op-amp (`taction parts import`), in the place of a preset"
    )
    level: Literal["auto", "small-signal", "large-signal"] = field(
        "auto",
        description="of the macromodel; auto: with slew rate and swing, and with the largest output"
        " current, where the small-signal board exceeds 90 % of such a limit",
    )
    dc_gain: Positive | None = None
    gbw: Hertz | None = None
    second_pole: Hertz | None = None
    phase_margin: Annotated[float, Number(gt=0, lt=90)] | None = field(
        None, description="degrees, at unity gain; sets the second pole"
    )
    input_resistance: Ohms | None = None
    differential_capacitance: FaradsOrZero | None = None
    input_capacitance: FaradsOrZero | None = None
    output_resistance: OhmsOrZero | None = None
    slew_rate: VoltsPerSecond | None = field(None, description="of the output")
    output_current: Amps | None = field(None, description="largest, of either sign")
    saturation: VoltsOrZero | None = field(
        None, description="least distance of the output from a supply voltage"
    )
    least_supply: VoltsOrZero | None = None
    most_supply: Volts | None = None
    voltage_noise: VoltageDensityOrZero | None = field(None, description="of the input, white")
    current_noise: CurrentDensityOrZero | None = field(None, description="of each input, white")
    voltage_noise_corner: HertzOrZero | None = field(
        None, description="below it the 1/f part of the voltage noise is the larger one; 0: none"
    )
    supply_current: AmpsOrZero | None = field(None, description="of one op-amp without load")
    channels_per_package: Count | None = field(None, description="op-amps in one package")
    input_errors: InputErrors = field(
        "typical",
        description="offset voltage, input currents and common-mode error of every op-amp: the"
        " typical or the largest size of its sheet, or none but those that are given here",
    )
    offset_voltage: SignedVolts | None = field(None, description="at the non-inverting input")
    bias_current: SignedAmps | None = field(
        None, description="mean of the currents into both inputs"
    )
    offset_current: SignedAmps | None = field(
        None, description="current into the non-inverting input less the other"
    )
    common_mode_rejection: Positive | None = field(None, description="dB")
    offset_drift: VoltsPerKelvinOrZero | None = field(
        None, description="typical size, of the offset voltage; counts with design.temperature"
    )
    bias_drift: AmpsPerKelvinOrZero | None = field(
        None, description="typical size, of the bias current; counts with design.temperature"
    )
    bias_doubling: Kelvins | None = field(
        None, description="warming that doubles the input currents, as of field-effect inputs"
    )
    supply_rejection: Positive | None = field(
        None, description="dB; counts with design.supply_tolerance"
    )

    def contradiction(self) -> str:
        """Return which of the keys that are given excludes the file."""
        others = sorted(self.model_fields_set - {"file"})
        if self.file is None or not others:
            return ""
        return f"'file' excludes {others[0]!r}: an imported op-amp is as measured"


class Design(Model):
    """The board's components."""

    topology: Annotated[str, NAMES["topology"]] = "integrator"
    amplifier: Annotated[str, NAMES["amplifier"]] = "linear"
    capacitance: Farads = 1e-11
    resistance: Ohms | None = None
    lam: LambdaOrRule | None = field(
        None, alias="lambda", description="regularisation parameter, or the rule that chooses it"
    )
    gain: Ohms = 6.252e6
    feedback_conductance: Siemens | None = field(
        None,
        description="gf of the first stages of a closed-loop board, whose speed and stability it"
        " decides; by default unit_conductance",
    )
    negative_entries: Literal["inverters", "differential", "offset"] = field(
        "inverters",
        description="of a closed-loop board: an inverter for each driver, the other inputs of the"
        " op-amps, or one column behind an inverter of the sum",
    )
    unit_conductance: Siemens = 3.313e-7
    unit_voltage: Volts = 1.0
    exponential_slope: Volts | None = None
    bias: bool | None = field(None, description="bias current I_b = Ve/R")
    antilog: AntilogChoice = field(
        AntilogChoice(), description="exponential amplifiers: ideal, or of transistors"
    )
    opamp: OpAmpChoice = OpAmpChoice()
    supply: SupplyVolts = field(15.0, description="both supply voltages of the op-amps, as '±15V'")
    temperature: Annotated[str, TemperatureRange()] | None = field(
        None,
        description="at which the board must work: the drift of input errors and resistors from 25"
        " degrees C counts in the check steady_state and in the error budget",
    )
    supply_tolerance: Annotated[float, Number(ge=0, lt=1)] = field(
        0.0, description="fraction of the supply voltages; supply rejection counts, as temperature"
    )
    temperature_coefficient: NonNegative = field(
        0.0, description="per K, the largest of any resistor; each has its own; needs temperature"
    )
    stray_capacitance: FaradsOrZero = 1e-11
    sensor_noise: CurrentDensityOrZero = field(
        0.0, description="of every strain, white; for the check 'noise'"
    )
    strain_input: Literal["current", "voltage"] = field(
        "current",
        description="source of every strain: a current into its summing node, or eps U0 through a"
        " resistor 1/G0",
    )
    inverter_resistance: Ohms = 1e4
    prune: Annotated[float, Number(ge=0, lt=1)] = field(
        0.0, description="entries of T below this fraction of the largest have no resistors"
    )
    resistor_series: Literal["exact", "E24", "E96", "E192"] = "exact"
    capacitor_series: Literal["exact", "E6", "E12", "E24"] = field(
        "exact", description="of C; a stray capacitance is no part"
    )

    @classmethod
    def contradictions(cls, data: Mapping[str, Any]) -> Iterator[Complaint]:
        """Yield each key that contradicts another one."""
        for key, reason in _contradictions(data):
            yield Complaint(key, value_text(data[key]), reason)

    @property
    def surroundings(self) -> Surroundings:
        """Temperatures and supply voltages at which the board must work."""
        match = None if self.temperature is None else RANGE.fullmatch(self.temperature)
        ends = (ROOM, ROOM) if match is None else tuple(map(float, match.groups()))
        volts = self.supply_tolerance * self.supply
        return Surroundings(min(ends[0] - ROOM, 0.0), max(ends[1] - ROOM, 0.0), volts)

    @property
    def biased(self) -> bool:
        """Whether a bias current flows, by the scene or by the default of the amplifier."""
        return AMPLIFIERS[self.amplifier].biased if self.bias is None else self.bias


def _contradictions(design: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield each key of a design that contradicts another key, with the reason."""
    if design.get("lambda") is not None and design.get("resistance") is not None:
        yield "lambda", "excludes 'resistance': give one of the two"
    if design.get("amplifier", "linear") == "linear":
        for key in ("exponential_slope", "bias"):
            if design.get(key) is not None:
                yield key, "needs a nonlinear amplifier, such as 'exponential'"
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
