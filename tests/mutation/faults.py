"""Changes of a circuit, of a problem, of a record: what a mistake would make of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.system.array_types import Complexes, Floats
from taction.system.reading_definitions import TIMES
from taction.system.waveforms import Waveforms
from taction.verification.readings.measurements import ChannelMeasure, Measurements, summary

CircuitChange = Callable[[Circuit], Circuit]
ProblemChange = Callable[[InverseProblem], InverseProblem]
WaveformsChange = Callable[[Waveforms], Waveforms]


def _each(circuit: Circuit, kind: str, name: str, change: Callable[[Any], Any]) -> Circuit:
    """Change the parts of a `kind` whose names begin with `name`; there must be such a part."""
    found = getattr(circuit, kind)
    changed = tuple(change(part) if part.name.startswith(name) else part for part in found)
    assert changed != found
    return replace(circuit, **{kind: changed})


def scaled(kind: str, name: str, **factors: float) -> CircuitChange:
    """Multiply fields of the parts of a `kind` whose names begin with `name`."""

    def change(part: Any) -> Any:
        return replace(part, **{field: getattr(part, field) * x for field, x in factors.items()})

    return lambda circuit: _each(circuit, kind, name, change)


def figures(**changes: float) -> CircuitChange:
    """Change figures of every op-amp type."""
    return lambda circuit: replace(
        circuit, models={name: replace(m, **changes) for name, m in circuit.models.items()}
    )


def other_model(cell: str, preset: str) -> CircuitChange:
    """Give one cell the op-amp of a preset."""

    def change(circuit: Circuit) -> Circuit:
        models = {**circuit.models, preset: OPAMPS[preset]}
        changed = _each(circuit, "opamps", cell, lambda part: replace(part, model=preset))
        return replace(changed, models=models)

    return change


def swapped_inputs(cell: str) -> CircuitChange:
    """Swap the two inputs of one cell."""
    return lambda circuit: _each(
        circuit,
        "opamps",
        cell,
        lambda part: replace(part, noninverting=part.inverting, inverting=part.noninverting),
    )


def without_inverters(circuit: Circuit) -> Circuit:
    """Drive the feedback resistors of negative entries by w, without its inverter."""
    forward, feedback = circuit.matrices
    assert feedback.negative.any()
    return replace(circuit, matrices=(forward, replace(feedback, minus=feedback.plus)))


def without_bias(circuit: Circuit) -> Circuit:
    """Leave the bias source and its resistors out."""
    resistors = tuple(part for part in circuit.resistors if not part.name.startswith("bias_"))
    assert resistors != circuit.resistors
    return replace(circuit, voltages=(), resistors=resistors)


def without_current(circuit: Circuit) -> Circuit:
    """Leave the first strain current out."""
    return replace(circuit, currents=circuit.currents[1:])


def without_feedback_resistor(circuit: Circuit) -> Circuit:
    """Leave the first resistor of the feedback plane out."""
    forward, feedback = circuit.matrices
    ohms = feedback.ohms.copy()
    assert np.isfinite(ohms[0, 0])
    ohms[0, 0] = np.inf
    return replace(circuit, matrices=(forward, replace(feedback, ohms=ohms)))


def swapped_outputs(circuit: Circuit) -> Circuit:
    """Swap the first two outputs."""
    first, second, *rest = circuit.outputs
    return replace(circuit, outputs=(second, first, *rest))


def negated_output(circuit: Circuit) -> Circuit:
    """Read the first output with the wrong sign."""
    first, *rest = circuit.outputs
    return replace(circuit, outputs=(replace(first, sign=-first.sign), *rest))


def matrix_entry(row: int, column: int, factor: float) -> ProblemChange:
    """Multiply one entry of T."""

    def change(problem: InverseProblem) -> InverseProblem:
        T = problem.matrix.copy()
        assert T[row, column] != 0.0
        T[row, column] *= factor
        return replace(problem, matrix=T)

    return change


def strain_entry(row: int, factor: float) -> ProblemChange:
    """Multiply one strain."""

    def change(problem: InverseProblem) -> InverseProblem:
        eps = problem.strain.copy()
        eps[row] *= factor
        return replace(problem, strain=eps)

    return change


def transposed(problem: InverseProblem) -> InverseProblem:
    """Take T for its transpose."""
    assert not np.array_equal(problem.matrix, problem.matrix.T)
    return replace(problem, matrix=problem.matrix.T.copy())


def columns(order: Sequence[int]) -> WaveformsChange:
    """Return the values of other columns under the names of the first ones."""

    def change(waveforms: Waveforms) -> Waveforms:
        values = np.array(waveforms.values)
        values[:, : len(order)] = waveforms.values[:, list(order)]
        return replace(waveforms, values=values)

    return change


def stretched_time(factor: float) -> WaveformsChange:
    """Multiply the instants."""
    return lambda waveforms: replace(waveforms, time=waveforms.time * factor)


def stale_column(factor: float) -> WaveformsChange:
    """Take the first column from a run with a strain of `factor` times (the board is linear)."""

    def change(waveforms: Waveforms) -> Waveforms:
        values = np.array(waveforms.values)
        values[:, 0] *= factor
        return replace(waveforms, values=values)

    return change


def without_uncertainties(measured: Measurements) -> Measurements:
    """Drop the uncertainties of all times."""

    def certain(channel: ChannelMeasure) -> ChannelMeasure:
        known = {name: channel.readings[name] for name in TIMES}
        times = {name: found and replace(found, uncertainty=0.0) for name, found in known.items()}
        return replace(channel, readings={**channel.readings, **times})

    channels = [certain(channel) for channel in measured.channels]
    return summary(measured.amplitude, measured.band, measured.modes, channels)


def without_strongest(shares: Complexes) -> Complexes:
    """Leave the strongest mode (a conjugate pair has two columns) out of the shares (K, n)."""
    size: Floats = np.abs(shares).max(axis=0)
    return np.where(size < 0.999 * size.max(), shares, 0.0)
