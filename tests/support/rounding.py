"""A rounding adversary: changes the numbers inside the engine by what another processor may."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np

from taction.verification.engines.statespace.equations import stamps
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.transients import exact, stepped
from taction.verification.verdict import companion

SIZE = 4e-16  # relative; standard deviation
TRANSIENTS = (exact, stepped)


@contextmanager
def rounded(seed: int) -> Iterator[None]:
    """Multiply every stamped value, initial state and recorded sample by ``1 + SIZE z``."""
    rng = np.random.default_rng(seed)

    def nudged(x: Any) -> Any:
        return x * (1.0 + SIZE * rng.standard_normal(np.shape(x)))

    def after(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *given, **named: nudged(function(*given, **named))

    def stamped(*given: Any, **named: Any) -> Descriptor:
        d = Descriptor(*given, **named)
        scales = {"u_scale": nudged(d.devices.u_scale), "v_scale": nudged(d.devices.v_scale)}
        return replace(
            d,
            mass=replace(d.mass, values=nudged(d.mass.values)),
            local=replace(d.local, values=nudged(d.local.values)),
            couplings=tuple(replace(c, conductance=nudged(c.conductance)) for c in d.couplings),
            switched=nudged(d.switched),
            constant=nudged(d.constant),
            devices=replace(d.devices, **scales),
        )

    begins = [(room, "initial_unknowns") for room in TRANSIENTS]
    with ExitStack() as changed:
        changed.enter_context(patch.object(stamps, "Descriptor", stamped))
        for owner, name in (*begins, (companion, "outputs")):
            changed.enter_context(patch.object(owner, name, after(getattr(owner, name))))
        yield
