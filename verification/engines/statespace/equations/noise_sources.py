"""White noise in the rows of the descriptor equations: resistors, op-amps, sensors.

A resistor has the thermal current ``4 k T / R`` (A²/Hz). An op-amp has a voltage noise, which adds
to the input of its gain stages behind the input impedances, and a current noise into each input
that is not on ground. The impedances of an op-amp's model are no resistors of the part: they make
no noise of their own. A transistor has the shot noise ``2 q I`` of collector and base current, and
the thermal noise of its bulk resistance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, OpAmpCell
from taction.spice_models.opamp import OpAmp
from taction.spice_models.thermal_noise import THERMAL
from taction.spice_models.transistor import ELECTRON
from taction.system.array_types import Floats, Ints
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.transistor_stamps import transistor_currents


def noise_intensities(
    circuit: Circuit, descriptor: Descriptor, point: Floats | None = None
) -> Floats:
    """Return the covariance of the noise in each pair of rows, over positive and negative f.

    `point` (size,) is the equilibrium, which sets the currents of transistors; without it they are
    silent.

    Returns
    -------
    ndarray (size, size)
        In A²/Hz for current balances, V²/s²/Hz for states of op-amps, V²/Hz for rows that state a
        voltage; half of the density over positive frequencies.
    """
    size = descriptor.size
    density = np.zeros((size + 1, size + 1))  # the last row is ground
    _resistors(density, circuit, descriptor)
    for cell in circuit.opamps:
        pins = _places(descriptor, (cell.noninverting, cell.inverting))
        density[pins, pins] += circuit.models[cell.model].current_noise ** 2
    for source in circuit.noises:
        place = descriptor.place(source.node)
        density[place, place] += source.density**2
    taken = np.append(descriptor.determined, True)  # an ideal source takes up the current
    if point is not None and circuit.transistors:
        _transistors(density, circuit, descriptor, point)
    density[taken] = 0.0
    density[:, taken] = 0.0
    for cell in circuit.opamps:
        row, gain = _gain_stage(circuit.models[cell.model], cell, descriptor)
        density[row, row] += (gain * circuit.models[cell.model].voltage_noise) ** 2
    return 0.5 * density[:size, :size]


def _resistors(density: Floats, circuit: Circuit, descriptor: Descriptor) -> None:
    parts = [(part.a, part.b, part.ohms) for part in circuit.resistors]
    for matrix in circuit.matrices:
        parts += [element[2:] for element in matrix.elements()]
    a = _places(descriptor, (end for end, _, _ in parts))
    b = _places(descriptor, (end for _, end, _ in parts))
    _between(density, a, b, THERMAL / np.array([ohms for _, _, ohms in parts]))


def _transistors(density: Floats, circuit: Circuit, descriptor: Descriptor, point: Floats) -> None:
    """Add shot noise of collector and base current, and thermal noise of the bulk resistance."""
    cells = circuit.transistors
    collector, base, emitter = (
        _places(descriptor, (getattr(cell, leg) for cell in cells))
        for leg in ("collector", "base", "emitter")
    )
    inner = _places(descriptor, (f"q{cell.name}.e" for cell in cells))
    models = [circuit.transistor_models[cell.model] for cell in cells]
    currents = np.abs(transistor_currents(circuit, descriptor, point))
    _between(density, collector, inner, 2.0 * ELECTRON * currents[0])
    _between(density, base, inner, 2.0 * ELECTRON * currents[1])
    _between(density, emitter, inner, THERMAL / np.array([m.emitter_resistance for m in models]))


def _between(density: Floats, a: Ints, b: Ints, current: Floats) -> None:
    """Add noise currents, A²/Hz, between places."""
    for p, q in ((a, b), (b, a)):
        np.add.at(density, (p, p), current)
        np.add.at(density, (p, q), -current)


def _places(descriptor: Descriptor, names: Iterable[str]) -> Ints:
    places = [descriptor.size if name == GROUND else descriptor.place(name) for name in names]
    return np.array(places, dtype=np.int64)


def _gain_stage(model: OpAmp, cell: OpAmpCell, descriptor: Descriptor) -> tuple[int, float]:
    """Return the row that the input voltage of an op-amp drives, and its gain there."""
    if math.isfinite(model.gbw):
        return descriptor.place(f"x{cell.name}.p1"), 2.0 * math.pi * model.gbw
    return descriptor.place(cell.output), model.dc_gain / (model.output_resistance or 1.0)
