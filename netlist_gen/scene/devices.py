"""The conductance devices of a board's arrays: the table ``[devices]`` of a scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taction.netlist_gen.scene.fields import Model, Siemens

Levels = Annotated[int, Field(strict=True, ge=2, le=65536)]


class DevicesTable(Model):
    """Devices in the place of the arrays' resistors; without any key there are resistors."""

    cell: Literal["rram-wan", "rram-milo", "pcm-joshi"] | None = Field(
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
