"""The state in which a transient begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from verification.engines.descriptor import StateSpace
from verification.engines.equilibrium import equilibrium
from verification.engines.modes import Floats

Initial = Literal["zero", "rest"]


def initial_state(
    space: StateSpace, initial: Initial, voltages: Mapping[str, float] | None = None
) -> Floats:
    """State at t = 0, shape (n,).

    ``"rest"`` is the equilibrium with the current sources off; ``"zero"`` has every capacitor and
    op-amp discharged, except that `voltages` (V, by node or op-amp state) charge what is connected
    to them.

    Raises
    ------
    EngineError
        A name that the circuit does not have, or no equilibrium.
    """
    descriptor = space.descriptor
    if initial == "zero":
        if not voltages:
            return space.charge_offset
        z = np.zeros(descriptor.size)
        for name, volts in voltages.items():
            z[descriptor.place(name)] = volts
        return space.state_of(z)
    if np.any(descriptor.constant) or descriptor.devices.count:
        return space.state_of(equilibrium(descriptor, sources_on=False).values)
    return space.charge_offset
