"""From a scene and its problem to a `Circuit`, by the topology of the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taction.netlist_gen.board.circuit import NEEDED, Circuit, ResistorMatrix
from taction.netlist_gen.board.preferred_values import nearest
from taction.netlist_gen.board.wired_arrays import as_ohms
from taction.netlist_gen.board.wires import Wires, compensated
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.table import topology_of


def synthesise(scene: Scene, problem: InverseProblem | None = None) -> Circuit:
    """Design the board of `scene` for `problem`, by default the scene's own problem.

    Raises
    ------
    InputError
        A number of the design is out of range, or the topology cannot be built for the scene.

    Examples
    --------
    >>> import taction
    >>> circuit = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> len(circuit.outputs), circuit.topology
    (7, 'integrator')
    """
    problem = make_problem(scene) if problem is None else problem
    circuit = topology_of(scene).synthesise(scene, problem)
    for name in NEEDED:
        circuit.value(name)
    if scene.wires.ideal:
        return circuit
    return replace(circuit, matrices=tuple(_wired(each, scene) for each in circuit.matrices))


def _wired(matrix: ResistorMatrix, scene: Scene) -> ResistorMatrix:
    """Return a matrix with the wires of its scene, and with resistors that compensate them."""
    wires = Wires(**scene.wires.model_dump(exclude={"compensate"}))
    if not scene.wires.compensate:
        return replace(matrix, wires=wires)
    siemens = np.where(matrix.negative, -1.0, 1.0) / matrix.ohms
    ohms = as_ohms(np.abs(compensated(siemens, wires, by_column=matrix.by_column)))
    ohms = nearest(ohms, scene.design.resistor_series)
    scale = np.divide(ohms, matrix.ohms, out=np.ones_like(ohms), where=np.isfinite(ohms))
    return replace(matrix, ohms=ohms, wires=replace(wires, scale=scale))
