"""From a scene and its problem to a `Circuit`, by the topology of the scene."""

from __future__ import annotations

from dataclasses import replace

from taction.netlist_gen.board.built_arrays import built, device_of
from taction.netlist_gen.board.circuit import NEEDED, Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of


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
    device = device_of(scene)
    if scene.wires.ideal and device is None:
        return circuit
    matrices = tuple(built(each, scene, device) for each in circuit.matrices)
    return replace(circuit, matrices=matrices)
