"""Stamps of imported op-amps: their linear model, term by term.

The current i into the output is an unknown with the row
``0 = -v_out + rest + D_g (d - offset) + sum x + D_z i + sum y``, ``d = v_p - v_n``; every pole p of
the gain is a state ``x' = p x + r (d - offset)``, every pole of the impedance ``y' = p y + r i``. A
pair of complex poles is two real states with the same sum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from netlist_gen.board.circuit import OpAmpCell
from spice_models.array_types import Ints
from spice_models.errors import EngineError
from spice_models.imported import LinearModel, Rational
from verification.engines.statespace.equations.transistor_stamps import Stamper

GROUND = -1


def stamp_imported(
    stamper: Stamper, cells: Sequence[OpAmpCell], pins: Ints
) -> None:
    """Stamp op-amps; `pins` (P, 3) are plus, minus and output.

    Raises
    ------
    EngineError
        A model without resistance at its output.
    """
    for cell, (plus, minus, out) in zip(cells, pins.tolist(), strict=True):
        model = stamper.circuit.linear_model(cell)
        assert model is not None
        if not model.impedance.constant > 0.0:
            raise EngineError(f"op-amp {cell.model} has no output resistance at high frequencies")
        _inputs(stamper, model, (plus, minus))
        (current,) = stamper.nodes([f"x{cell.name}.i"]).tolist()
        _add(stamper, current, ((out, -1.0), (current, model.impedance.constant)))
        constant = model.gain.constant
        _add(stamper, current, ((plus, constant), (minus, -constant)))
        _bias(stamper, current, model.rest - constant * model.offset)
        stamper.currents.add(np.array([out]), np.array([current]), np.array([-1.0]))
        difference = ((plus, 1.0), (minus, -1.0))
        _states(stamper, cell, "g", model.gain, current, difference, -model.offset)
        _states(stamper, cell, "z", model.impedance, current, ((current, 1.0),), 0.0)


def _inputs(stamper: Stamper, model: LinearModel, pins: tuple[int, int]) -> None:
    """Stamp conductance, capacitance and bias current of both inputs."""
    for pin in pins:
        one = np.array([pin])
        stamper.currents.add(one, one, np.array([-model.conductance]))
        stamper.mass.add(one, one, np.array([model.capacitance]))
        # The conductance already takes its part of the current at the voltage of the measurement.
        part = model.conductance * (model.rest if pin == pins[1] else 0.0)
        _bias(stamper, pin, -(model.bias_current - part))


def _states(
    stamper: Stamper,
    cell: OpAmpCell,
    letter: str,
    rational: Rational,
    output: int,
    drive: tuple[tuple[int, float], ...],
    constant: float,
) -> None:
    """Stamp the states of a rational function of ``drive + constant``, and add them to `output`."""
    for k, (pole, residue) in enumerate(zip(rational.poles, rational.residues, strict=True), 1):
        names = [f"x{cell.name}.{letter}{k}{part}" for part in ("re", "im")[: 2 if pole.imag else 1]]
        places = stamper.nodes(names).tolist()
        # 2 Re of z' = pole z + residue d, with z = (a + j b) / 2.
        weights = (2.0 * residue.real, 2.0 * residue.imag) if pole.imag else (residue.real,)
        for place, weight in zip(places, weights, strict=True):
            stamper.mass.add(np.array([place]), np.array([place]), np.ones(1))
            _add(stamper, place, tuple((node, weight * gain) for node, gain in drive))
            _add(stamper, place, ((place, pole.real),))
            _bias(stamper, place, weight * constant)
        if pole.imag:
            real, imaginary = places
            _add(stamper, real, ((imaginary, -pole.imag),))
            _add(stamper, imaginary, ((real, pole.imag),))
        _add(stamper, output, ((places[0], 1.0),))


def _add(stamper: Stamper, row: int, terms: tuple[tuple[int, float], ...]) -> None:
    columns, values = zip(*terms, strict=True)
    rows = np.full(len(terms), row, dtype=np.int64)
    stamper.laws.add(rows, np.array(columns, dtype=np.int64), np.array(values))


def _bias(stamper: Stamper, row: int, value: float) -> None:
    if row != GROUND:
        stamper.bias(np.array([row], dtype=np.int64), np.array([value]))
