"""The op-amps' links of the error budget: the same board with more and more of their figures.

The first board has ideal op-amps, so that only its resistors are as built. Each link gives the
op-amps some more figures, and the last board is the one that is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Floats
from spice_models.opamp import OpAmp
from verification.engines.statespace.linearised.board import LinearBoard

IDEAL_GAIN = 1e15  # the gain error of a whole board is then at the rounding of its equilibrium


@dataclass(frozen=True, slots=True)
class OpAmpLink:
    """Figures of an op-amp that make one part of the error budget.

    Attributes
    ----------
    name : str
        Of the part.
    figures : tuple of str
        Fields of `OpAmp`; without these the field has its default, the gain `IDEAL_GAIN`.
    how : str
        The comparison that gives the part.
    """

    name: str
    figures: tuple[str, ...]
    how: str


LINKS = (
    OpAmpLink(
        "opamps",
        ("dc_gain", "gbw", "second_pole", "input_resistance", "output_resistance"),
        "finite gain and impedances of the op-amps: equilibrium with against without",
    ),
    OpAmpLink(
        "limits",
        ("large_signal",),
        "slew rate and swing of the op-amps: equilibrium with against without",
    ),
)
_NEUTRAL: dict[str, Any] = {f.name: f.default for f in fields(OpAmp)} | {"dc_gain": IDEAL_GAIN}


def with_ideal_opamps(circuit: Circuit) -> Circuit:
    """Return `circuit` with op-amps that add no error at rest."""
    return _with_links(circuit, 0)


def opamp_stages(board: LinearBoard) -> Iterator[tuple[OpAmpLink, LinearBoard]]:
    """Yield each link that `board` has, and the board with the figures up to this link.

    The last one is `board` itself. A link whose figures no op-amp of the board has is left out.
    """
    before = with_ideal_opamps(board.circuit)
    for count, link in enumerate(LINKS, 1):
        circuit = _with_links(board.circuit, count)
        if circuit.models == before.models:
            continue
        before = circuit
        yield link, board if circuit.models == board.circuit.models else LinearBoard(circuit)


def outputs_at_rest(board: LinearBoard) -> Floats:
    """Return u of every channel at the equilibrium, V, (N,).

    Raises
    ------
    EngineError
        The board has no equilibrium.
    """
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])


def _with_links(circuit: Circuit, count: int) -> Circuit:
    """Return `circuit` with the figures of the first `count` links."""
    absent = {name: _NEUTRAL[name] for link in LINKS[count:] for name in link.figures}
    models = {name: replace(model, **absent) for name, model in circuit.models.items()}
    return replace(circuit, models=models)
