"""From a scene and its problem to a `Circuit`, with the wires and devices of its arrays."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.arrays import (
    LOGARITHMIC,
    Device,
    Logarithmic,
    Wires,
    compensated,
    load_devices,
)
from taction.netlist_gen.board.bill_of_materials import nearest
from taction.netlist_gen.board.circuit import NEEDED, Circuit
from taction.netlist_gen.board.parts import ResistorMatrix, as_ohms
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError


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


def built(matrix: ResistorMatrix, scene: Scene, device: Device | None) -> ResistorMatrix:
    """Return a matrix with the wires and devices of its scene, and with what compensates wires."""
    asked, ohms = scene.wires, matrix.ohms
    wires = None if asked.ideal else Wires(**asked.model_dump(exclude={"compensate"}))
    if wires is not None and scene.wires.compensate:
        siemens = np.where(matrix.negative, -1.0, 1.0) / ohms
        ohms = as_ohms(np.abs(compensated(siemens, wires, by_column=matrix.by_column)))
        ohms = nearest(ohms, scene.design.resistor_series)
    ohms = as_programmed(ohms, device)
    if wires is not None and scene.wires.compensate:
        scale = np.divide(ohms, matrix.ohms, out=np.ones_like(ohms), where=np.isfinite(ohms))
        wires = replace(wires, scale=scale)
    return replace(matrix, ohms=ohms, wires=wires, device=device)


def as_programmed(ohms: Floats, device: Device | None) -> Floats:
    """Return resistances as devices have them, set to their levels and at their age."""
    return ohms if device is None else as_ohms(device.drifted(device.settable(1.0 / ohms)))


def device_of(scene: Scene) -> Device | None:
    """Return the devices of a scene; None for resistors. Refuse a window that is none."""
    asked = scene.devices
    if not asked.model_fields_set:
        return None
    device = Device() if asked.cell is None else load_devices()[asked.cell]
    given: dict[str, Any] = asked.model_dump(exclude={"cell"}, exclude_none=True)
    if "programming_error" in given:
        given["programming_error"] = (given["programming_error"],)
    given |= {name: Logarithmic(given[name]) for name in LOGARITHMIC & given.keys()}
    device = replace(device, **given)
    least, most = device.least_conductance, device.most_conductance
    stuck, windowed = f"{device.stuck_at_most:g}", math.isfinite(most)
    wrong = (
        (not least < most, "most_conductance", f"{most:g}",
         f"not above the least conductance of {least:g} S"),
        (device.stuck >= 1.0, "stuck_at_most", stuck, "with stuck_at_least this must be below 1"),
        (device.stuck_at_most and not windowed, "stuck_at_most", stuck,
         "cells stuck at the largest conductance need 'most_conductance', or a 'cell'"),
        (device.cell_levels and not windowed, "cell_levels", repr(device.cell_levels),
         "levels need 'most_conductance', or a 'cell'"),
    )  # fmt: skip
    for is_wrong, key, value, text in wrong:
        if is_wrong:
            raise InputError(scene.file, Complaint(f"devices.{key}", value, text))
    return device
