"""The state in which a transient begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from spice_models.array_types import Floats
from verification.engines.statespace.linearised.equilibrium import equilibrium
from verification.engines.statespace.linearised.state_space import StateSpace

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
