"""Stamps of imported op-amps: their linear model, term by term.

The current i into the output is an unknown with the row
``0 = -v_out + rest + D_g (d - offset) + D_z i + sum x``, ``d = v_p - v_n``; every pole p of gain
and impedance is a state ``x' = p x + r_g (d - offset) + r_z i``. A pair of complex poles is two
real states.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taction.netlist_gen.board.circuit import OpAmpCell
from taction.spice_models.imported import LinearModel
from taction.system.array_types import Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.stamper import Stamper


def stamp_imported(stamper: Stamper, cells: Sequence[OpAmpCell], pins: Ints) -> None:
    """Stamp op-amps; `pins` (P, 3) are plus, minus and output.

    Raises
    ------
    EngineError
        A model without resistance at its output.
    """
    for cell, (plus, minus, out) in zip(cells, pins.tolist(), strict=True):
        model = stamper.circuit.linear_model(cell)
        if model is None:
            continue
        if not model.impedance.constant > 0.0:
            raise EngineError(f"op-amp {cell.model} has no output resistance at high frequencies")
        _inputs(stamper, model, (plus, minus))
        (current,) = stamper.nodes([f"x{cell.name}.i"]).tolist()
        _add(stamper, current, ((out, -1.0), (current, model.impedance.constant)))
        constant = model.gain.constant
        _add(stamper, current, ((plus, constant), (minus, -constant)))
        _bias(stamper, current, model.rest - constant * model.offset)
        stamper.currents.add(np.array([out]), np.array([current]), np.array([-1.0]))
        _states(stamper, cell, model, current, (plus, minus))


def _inputs(stamper: Stamper, model: LinearModel, pins: tuple[int, int]) -> None:
    """Stamp conductance, capacitance and bias current of both inputs."""
    for pin in pins:
        one = np.array([pin])
        stamper.currents.add(one, one, np.array([-model.conductance]))
        stamper.mass.add(one, one, np.array([model.capacitance]))
        # The conductance already takes its part of the current at the voltage of the measurement.
        part = model.conductance * (model.rest if pin == pins[1] else 0.0)
        stamper.constant_currents.append((one, np.array([part - model.bias_current])))


def _states(
    stamper: Stamper, cell: OpAmpCell, model: LinearModel, current: int, pins: tuple[int, int]
) -> None:
    """Stamp the states, and add them to the row of the current."""
    residues = zip(model.gain.residues, model.impedance.residues, strict=True)
    for k, (pole, (of_d, of_i)) in enumerate(zip(model.gain.poles, residues, strict=True), 1):
        names = [f"x{cell.name}.s{k}{part}" for part in ("re", "im")[: 2 if pole.imag else 1]]
        places = stamper.nodes(names).tolist()
        # A pair: the sum of z' = p z + r d and its conjugate is a with a' = pr a - pi b + 2 rr d,
        # b' = pi a + pr b + 2 ri d.
        parts = [(2.0 * of_d.real, 2.0 * of_i.real), (2.0 * of_d.imag, 2.0 * of_i.imag)]
        for place, (d, i) in zip(
            places, parts if pole.imag else [(of_d.real, of_i.real)], strict=True
        ):
            stamper.mass.add(np.array([place]), np.array([place]), np.ones(1))
            terms = ((pins[0], d), (pins[1], -d), (current, i), (place, pole.real))
            _add(stamper, place, terms)
            _bias(stamper, place, -d * model.offset)
        if pole.imag:
            real, imaginary = places
            _add(stamper, real, ((imaginary, -pole.imag),))
            _add(stamper, imaginary, ((real, pole.imag),))
        _add(stamper, current, ((places[0], 1.0),))


def _add(stamper: Stamper, row: int, terms: tuple[tuple[int, float], ...]) -> None:
    columns, values = zip(*terms, strict=True)
    rows = np.full(len(terms), row, dtype=np.int64)
    stamper.laws.add(rows, np.array(columns, dtype=np.int64), np.array(values))


def _bias(stamper: Stamper, row: int, value: float) -> None:
    stamper.constant_laws.append((np.array([row], dtype=np.int64), np.array([value])))
