"""The op-amps' links of the error budget: the same board with more and more of their figures.

The first board has ideal op-amps, so that only its resistors are as built. Each link gives the
op-amps some more figures, and the last board is the one that is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard

IDEAL_GAIN = 1e15  # the gain error of a whole board is then at the rounding of its equilibrium


@dataclass(frozen=True, slots=True)
class OpAmpLink:
    """Figures of an op-amp that make one part of the error budget.

    Attributes
    ----------
    name : str
        Of the part.
    figures : tuple of str
        Fields of `OpAmp`; without these a field has its default, the gain `IDEAL_GAIN`.
    how : str
        The comparison that gives the part.
    switch : str
        Field that has to be true for these figures to be in the macromodel, or empty.
    """

    name: str
    figures: tuple[str, ...]
    how: str
    switch: str = ""

    @property
    def fields(self) -> set[str]:
        """All fields that the link sets."""
        return {*self.figures, *filter(None, [self.switch])}

    def acts_on(self, model: OpAmp) -> bool:
        """Whether the macromodel of `model` has any of the figures."""
        on = not self.switch or getattr(model, self.switch)
        return on and any(getattr(model, name) != _NEUTRAL[name] for name in self.figures)


LINKS = (
    OpAmpLink(
        "opamps",
        ("dc_gain", "gbw", "second_pole", "input_resistance", "output_resistance", "imported"),
        "finite gain and impedances of the op-amps: equilibrium with against without",
    ),
    OpAmpLink(
        "offset_voltage",
        ("offset_voltage",),
        "offset voltage of the op-amps: equilibrium with against without",
        switch="input_errors",
    ),
    OpAmpLink(
        "input_currents",
        ("bias_current", "offset_current"),
        "bias and offset current of the op-amps: equilibrium with against without",
        switch="input_errors",
    ),
    OpAmpLink(
        "common_mode",
        ("common_mode_rejection",),
        "common-mode rejection of the op-amps: equilibrium with against without",
        switch="input_errors",
    ),
    OpAmpLink(
        "limits",
        ("slew_rate", "saturation", "output_current", "limits_current"),
        "limits of the op-amps: equilibrium with against without",
        switch="large_signal",
    ),
)
_NEUTRAL: dict[str, Any] = {f.name: f.default for f in fields(OpAmp)} | {"dc_gain": IDEAL_GAIN}


def with_ideal_opamps(circuit: Circuit) -> Circuit:
    """Return `circuit` with op-amps that add no error at rest."""
    return _with_links(circuit, [])


def opamp_stages(board: LinearBoard) -> Iterator[tuple[OpAmpLink, LinearBoard]]:
    """Yield each link that `board` has, and the board with the figures up to this link.

    The last one is `board` itself. There is none for op-amps without any such figure.
    """
    models = board.circuit.models.values()
    links = [link for link in LINKS if any(map(link.acts_on, models))]
    for count, link in enumerate(links[:-1], 1):
        yield link, LinearBoard(_with_links(board.circuit, links[:count]))
    if links:
        yield links[-1], board


def outputs_at_rest(board: LinearBoard) -> Floats:
    """Return u of every channel at the equilibrium, V, (N,).

    Raises
    ------
    EngineError
        The board has no equilibrium.
    """
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])


def _with_links(circuit: Circuit, links: list[OpAmpLink]) -> Circuit:
    """Return `circuit` with the figures of `links` only."""
    kept = set[str]().union(*(link.fields for link in links))
    every = set[str]().union(*(link.fields for link in LINKS))
    absent = {name: _NEUTRAL[name] for name in every - kept}
    models = {name: replace(model, **absent) for name, model in circuit.models.items()}
    return replace(circuit, models=models)
