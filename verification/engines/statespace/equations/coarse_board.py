"""A coarse board: every k-th channel and sensor of a large one, more strongly coupled.

Its cells, its loads and its low spatial modes are those of the whole board, so its poles tell
where those of the whole board are, and its transient what the strain step excites. It is a guide,
never an answer.
"""

from __future__ import annotations

import numpy as np

from spice_models.array_types import Bools, Ints
from verification.engines.statespace.equations.descriptor import (
    Coupling,
    Descriptor,
    Devices,
    Triplets,
)
from verification.engines.statespace.equations.mirror_symmetry import proposed_mirror

CHANNELS = 14  # of the coarse board, and sensors


def coarsen(descriptor: Descriptor, channels: int = CHANNELS) -> Descriptor:
    """Thin out a board.

    Parameters
    ----------
    descriptor : Descriptor
        The whole board.
    channels : int
        How many channels, and how many sensors, are kept, evenly spaced.

    Returns
    -------
    Descriptor
        With a subset of the names; the board itself where there is nothing to thin out.
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
            devices.kind,
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
    """Choose the unknowns to keep, and how much stronger the couplings become."""
    units = _units(descriptor)
    kept = units < 0
    gain, seen = 1.0, np.zeros(max(int(units.max(initial=0)) + 1, 1), dtype=np.bool_)
    for part in descriptor.couplings:
        fresh: Ints = np.unique(units[part.sinks])
        fresh = fresh[~seen[np.maximum(fresh, 0)] & (fresh >= 0)]
        if not len(fresh):
            continue
        seen[fresh] = True
        count = min(channels, len(fresh))
        chosen = fresh[np.linspace(0.0, len(fresh) - 1.0, count).round().astype(np.int64)]
        kept = kept | np.isin(units, chosen)
        gain = max(gain, len(fresh) / count)
    return kept, gain


def _units(descriptor: Descriptor) -> Ints:
    """Return the channel or sensor that each unknown belongs to; -1 for voltage sources.

    Unknowns belong together if anything but a resistor matrix or a voltage source ties them.
    """
    from scipy.sparse import coo_array, csgraph

    source = np.zeros(descriptor.size, dtype=np.bool_)
    alone = np.bincount(descriptor.local.rows, minlength=descriptor.size) == 1
    source[alone & descriptor.determined] = True
    source[descriptor.devices.output] = False
    pairs = [(t.rows, t.columns) for t in (descriptor.local, descriptor.mass)]
    pairs.append((descriptor.devices.input, descriptor.devices.output))
    rows, columns = (np.concatenate(side) for side in zip(*pairs, strict=True))
    tied = ~source[rows] & ~source[columns]
    shape = (descriptor.size, descriptor.size)
    ties = coo_array((np.ones(tied.sum()), (rows[tied], columns[tied])), shape=shape)
    unit = csgraph.connected_components(ties, directed=False)[1]
    return np.where(source, -1, unit)
