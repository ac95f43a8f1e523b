"""The table of topologies: one module each beside this folder, and those of other packages.

Other packages add a topology by an entry point of the group ``taction.topologies``: its name is
the word in the scene, its object a `Topology`.
"""

from __future__ import annotations

from collections.abc import Mapping

from taction.netlist_gen import topologies
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import Topology
from taction.system.plugins import OpenTable, objects_of

TOPOLOGIES: Mapping[str, Topology] = OpenTable(
    "taction.topologies", objects_of(topologies, "TOPOLOGY"), Topology
)
"""The topologies by the word in a scene."""


def topology_of(scene: Scene) -> Topology:
    """Return the topology of a scene."""
    return TOPOLOGIES[scene.design.topology]
