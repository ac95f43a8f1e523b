"""The initial state of a transient."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard

Initial = Literal["zero", "rest"]


def initial_unknowns(
    board: LinearBoard, initial: Initial, voltages: Mapping[str, float] | None = None
) -> Floats:
    """Return every unknown just before the strain step, V, shape (size,).

    ``"rest"`` is the equilibrium with the current sources off. With ``"zero"`` all capacitors and
    op-amps are discharged, except those that `voltages` (V, by node or op-amp state) charge.

    Raises
    ------
    EngineError
        The circuit does not have a name of `voltages`, or has no equilibrium.
    """
    if initial == "rest":
        return board.rest.values
    z = np.zeros(board.descriptor.size)
    for name, volts in (voltages or {}).items():
        z[board.descriptor.place(name)] = volts
    return z
