"""Make a coarse board: every k-th channel and sensor of a large board, more strongly coupled.

The coarse board has the cells, the loads and the low spatial modes of the whole board, so its poles
lie near those of the whole board, and its transient shows the modes that the strain step excites.
It serves for estimates only, never for a result.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Bools, Ints
from taction.verification.engines.statespace.equations.descriptor import (
    Coupling,
    Descriptor,
    Devices,
    Triplets,
)
from taction.verification.engines.statespace.equations.mirror_symmetry import proposed_mirror

CHANNELS = 14  # of the coarse board, and as many sensors


def coarsen(descriptor: Descriptor, channels: int = CHANNELS) -> Descriptor:
    """Keep about `channels` channels and as many sensors of a board, evenly spaced.

    The result has a subset of the names; a small board is returned unchanged.
    """
    kept, gain = _choose(descriptor, channels)
    if kept.all():
        return descriptor
    place = np.full(descriptor.size, -1)
    place[kept] = np.arange(kept.sum())
    names = tuple(name for name, keep in zip(descriptor.names, kept.tolist(), strict=True) if keep)
    devices = descriptor.devices
    used = kept[devices.input] & kept[devices.output]
    return Descriptor(
        names=names,
        node_count=int(kept[: descriptor.node_count].sum()),
        mass=_restrict(descriptor.mass, kept, place),
        local=_restrict(descriptor.local, kept, place),
        couplings=tuple(_thin(part, kept, place, gain) for part in descriptor.couplings),
        switched=descriptor.switched[kept],
        constant=descriptor.constant[kept],
        determined=descriptor.determined[kept],
        devices=Devices(
            tuple(kind for kind, kept in zip(devices.kinds, used.tolist(), strict=True) if kept),
            place[devices.input[used]],
            place[devices.output[used]],
            devices.u_scale[used],
            devices.v_scale[used],
        ),
        places={name: k for k, name in enumerate(names)},
        mirror=proposed_mirror(names),
    )


def _restrict(triplets: Triplets, kept: Bools, place: Ints) -> Triplets:
    both = kept[triplets.rows] & kept[triplets.columns]
    rows, columns = place[triplets.rows[both]], place[triplets.columns[both]]
    return Triplets(rows, columns, triplets.values[both])


def _thin(part: Coupling, kept: Bools, place: Ints, gain: float) -> Coupling:
    sinks, drivers = kept[part.sinks], kept[part.drivers]
    return Coupling(
        place[part.sinks[sinks]],
        place[part.drivers[drivers]],
        gain * part.conductance[np.ix_(sinks, drivers)],
        part.loaded[drivers],
    )


def _choose(descriptor: Descriptor, channels: int) -> tuple[Bools, float]:
    """Choose the unknowns to keep; return the factor of the couplings, too."""
    unit = units(descriptor)
    kept = unit < 0
    gain, assigned = 1.0, np.zeros(max(int(unit.max(initial=0)) + 1, 1), dtype=np.bool_)
    for part in descriptor.couplings:
        new_units: Ints = np.unique(unit[part.sinks])
        new_units = new_units[~assigned[np.maximum(new_units, 0)] & (new_units >= 0)]
        if not len(new_units):
            continue
        assigned[new_units] = True
        count = min(channels, len(new_units))
        chosen = new_units[np.linspace(0.0, len(new_units) - 1.0, count).round().astype(np.int64)]
        kept = kept | np.isin(unit, chosen)
        gain = max(gain, len(new_units) / count)
    return kept, gain


def units(descriptor: Descriptor) -> Ints:
    """Return the channel or sensor of each unknown; -1 for voltage sources.

    Two unknowns belong together if an element connects them that is neither a resistor matrix nor
    a constant voltage source; a source of a strain belongs to its sensor.
    """
    from scipy.sparse import coo_array, csgraph

    source = np.zeros(descriptor.size, dtype=np.bool_)
    single = np.bincount(descriptor.local.rows, minlength=descriptor.size) == 1
    source[single & descriptor.determined & (descriptor.switched == 0.0)] = True
    source[descriptor.devices.output] = False
    pairs = [(t.rows, t.columns) for t in (descriptor.local, descriptor.mass)]
    pairs.append((descriptor.devices.input, descriptor.devices.output))
    rows, columns = (np.concatenate(side) for side in zip(*pairs, strict=True))
    tied = ~source[rows] & ~source[columns]
    shape = (descriptor.size, descriptor.size)
    ties = coo_array((np.ones(tied.sum()), (rows[tied], columns[tied])), shape=shape)
    unit = csgraph.connected_components(ties, directed=False)[1]
    return np.where(source, -1, unit)
