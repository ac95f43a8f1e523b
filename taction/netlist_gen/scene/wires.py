"""The wires of a board's arrays: the table ``[wires]`` of a scene."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, StrictBool

from taction.netlist_gen.scene.fields import Model, OhmsOrZero


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
