"""The state in which a transient begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from spice_models.array_types import Floats
from verification.engines.statespace.linearised.board import LinearBoard

Initial = Literal["zero", "rest"]


def initial_unknowns(
    board: LinearBoard, initial: Initial, voltages: Mapping[str, float] | None = None
) -> Floats:
    """Every unknown just before the strain steps on, V, shape (size,).

    ``"rest"`` is the equilibrium with the current sources off; ``"zero"`` has every capacitor and
    op-amp discharged, except that `voltages` (V, by node or op-amp state) charge what is connected
    to them.

    Raises
    ------
    EngineError
        A name that the circuit does not have, or no equilibrium.
    """
    if initial == "rest":
        return board.rest.values
    z = np.zeros(board.descriptor.size)
    for name, volts in (voltages or {}).items():
        z[board.descriptor.place(name)] = volts
    return z
