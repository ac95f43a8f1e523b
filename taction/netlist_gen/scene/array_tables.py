"""The arrays of a board: the tables ``[wires]`` and ``[devices]`` of a scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool

from taction.netlist_gen.scene.fields import Model, NonNegative, OhmsOrZero, Real, Seconds, Siemens


class WiresTable(Model):
    """Resistances between the entries of an array and its op-amps; 0: none."""

    word_line: OhmsOrZero = Field(0.0, description="per pitch of the line of a row of T")
    bit_line: OhmsOrZero = Field(0.0, description="per pitch of the line of a column of T")
    driver: OhmsOrZero = Field(0.0, description="from the output of an op-amp to a line it drives")
    sense: OhmsOrZero = Field(0.0, description="from a line to the input that takes its current")
    corner: Literal["top-left", "top-right", "bottom-left", "bottom-right"] = Field(
        "top-left",
        description="where the ports of rows and columns are; row 1 is at the top, column 1 at the"
        " left",
    )
    compensate: StrictBool = Field(
        False,
        description="scale the resistors so that the arrays have the conductances of T at their"
        " ports, as far as this is possible",
    )

    @property
    def ideal(self) -> bool:
        """Whether no wire has a resistance."""
        return not (self.word_line or self.bit_line or self.driver or self.sense)


Share = Annotated[Real, Field(ge=0, lt=1)]
Levels = Annotated[int, Field(strict=True, ge=2, le=65536)]


class DevicesTable(Model):
    """Devices in the place of the arrays' resistors; without any key there are resistors."""

    cell: Literal["rram-wan", "rram-milo", "pcm-joshi", "pcm-aihwkit"] | None = Field(
        None, description="a device by its name, whose figures hold"
    )
    least_conductance: Siemens | None = Field(None, description="a smaller entry of T has this one")
    most_conductance: Siemens | None = Field(None, description="a larger entry of T has this one")
    cell_levels: Levels | None = Field(
        None, description="evenly spaced conductances; by default those of the cell, or any"
    )
    programming_error: Siemens | None = Field(
        None,
        description="standard deviation of every device after programming; by default that of the"
        " cell, as a function of its conductance",
    )
    read_noise: Share | None = Field(
        None, description="standard deviation from solve to solve, a fraction of the conductance"
    )
    drift_exponent: NonNegative | None = Field(
        None, description="nu: a device has g (t/t0)^-nu; by default that of the cell"
    )
    drift_spread: NonNegative | None = Field(
        None, description="standard deviation of nu among the devices"
    )
    drift_start: Seconds | None = Field(
        None, description="t0 since programming; by default that of the cell, or 1 s"
    )
    age: Seconds | None = Field(
        None, description="t since programming; by default devices have not drifted"
    )
    stuck_at_least: Share | None = Field(
        None, description="fraction of the cells that are stuck at the least conductance"
    )
    stuck_at_most: Share | None = Field(
        None, description="fraction of the cells that are stuck at the most conductance"
    )
