"""`Topology`: how a scene becomes a board, and what the board states about itself; their table.

The table has one module each beside this folder, and those of other packages.

Other packages add a topology by an entry point of the group ``taction.topologies``: its name is
the word in the scene, its object a `Topology`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from typing import ClassVar

import numpy as np

from taction.netlist_gen import topologies
from taction.netlist_gen.board.bill_of_materials import nearest
from taction.netlist_gen.board.circuit import Circuit, Fact, Knob, common_facts, common_knobs
from taction.netlist_gen.scene.fields import LARGE, LEAST, MOST, SMALL, Model
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.system.errors import Complaint, InputError
from taction.system.plugins import OpenTable


class Topology(ABC):
    """One way to build the network of a scene from parts.

    The facts and knobs here are those of a network in which lambda follows from R, the gain, G0
    and, if its amplifiers are not linear, from U0 and Ve. A topology may add its own.
    """

    name: ClassVar[str]  # the word in the scene
    keys: ClassVar[type[Model] | None] = None  # of its own table ``[design.NAME]``, if any
    # keys of ``[design]`` that have no effect on its boards
    unused: ClassVar[frozenset[str]] = frozenset({"feedback_conductance", "negative_entries"})
    # the two keys that a choice among designs moves
    searched: ClassVar[tuple[str, str]] = ("design.capacitance", "design.gain")
    exact: ClassVar[bool] = False  # whether a board rests at the solution of ``T u = eps``

    @abstractmethod
    def synthesise(self, scene: Scene, problem: InverseProblem) -> Circuit:
        """Design the board of `scene` for `problem`, with its roles, facts and knobs.

        Raises
        ------
        InputError
            The scene asks for what the topology does not have.
        """

    def facts(self, scene: Scene) -> dict[str, Fact]:
        """Return the numbers of the design by name, with R from lambda, or lambda from R.

        ``lam = 1 / (R s G0²)`` for linear amplifiers (eq (21) corrected) and
        ``lam = 2 Ve / (R s G0² U0)`` for exponential ones (eqs (16) and (8) in the board's units).

        Raises
        ------
        InputError
            R or lambda would not be a finite positive number.
        """
        design, slope = scene.design, slope_of(scene)
        linear = design.amplifier == "linear"
        scale = design.gain * design.unit_conductance**2
        product = 1.0 / scale if scale else np.inf
        if not linear:
            product *= 2.0 * slope / design.unit_voltage
        if isinstance(design.lam, str):
            text = (
                "expected a number; taction.verification.reference.lambda_rule finds it by a rule"
            )
            raise InputError(scene.file, Complaint("design.lambda", repr(design.lam), text))
        given = design.lam or design.resistance or DEFAULT_RESISTANCE
        other = product / given
        resistance, lam = (other, given) if design.lam is not None else (given, other)
        if not (LEAST <= resistance <= MOST and SMALL <= lam <= LARGE):
            text = (
                f"gain and unit_conductance give lambda times R = {product!r}, so R ="
                f" {resistance:g} ohm and lambda = {lam:g}: out of range; expected R between"
                f" {LEAST:g} and {MOST:g} ohm, lambda between {SMALL:g} and {LARGE:g}"
            )
            raise InputError(scene.file, Complaint("design", repr(given), text))
        numbers = {
            "G0": design.unit_conductance,
            "U0": design.unit_voltage,
            "R": resistance,
            "C": float(nearest(np.array([design.capacitance]), design.capacitor_series)[0]),
            "gain": design.gain,
            "lambda": lam,
        }
        return common_facts(**numbers, **({} if linear else {"Ve": slope}))

    def knobs(self, scene: Scene) -> tuple[Knob, ...]:
        """Return the keys of `scene` that can be moved, with the parts that they scale."""
        return common_knobs(linear=scene.design.amplifier == "linear")


def slope_of(scene: Scene) -> float:
    """Return Ve of a scene, V; 1 V, without effect, where it has none."""
    return scene.design.exponential_slope or 1.0


TOPOLOGIES: Mapping[str, Topology] = OpenTable(
    "taction.topologies",
    lambda: {n: import_module(f"{topologies.__name__}.{n}").TOPOLOGY for n in topologies.NAMES},
    Topology,
)
"""The topologies by the word in a scene."""


def topology_of(scene: Scene) -> Topology:
    """Return the topology of a scene."""
    return TOPOLOGIES[scene.design.topology]
