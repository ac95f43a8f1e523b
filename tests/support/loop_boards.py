"""Random closed-loop boards: a random T, way of negative entries, op-amp of one or two poles, and
capacitances at its inputs. Their truth is that of their deck's text.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.verification.evidence.stress.compare import compare
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.true_values import true_values

TOPOLOGIES = ("inv", "pinv", "ridge")
WAYS = ("inverters", "differential", "offset")
BAND = 0.01  # of the settling time
INVERTER = 1e4  # ohm


@dataclass(frozen=True)
class Comparison:
    """One board; `outside` names the numbers that are beyond their bounds."""

    topology: str
    way: str
    stable: bool
    numbers: int
    outside: tuple[str, ...]

    @property
    def counts(self) -> dict[str, float]:
        """What a study adds up."""
        return {"stable": self.stable, "numbers": self.numbers}


def board_scene(seed: int) -> Scene:
    """Return the scene of a seed."""
    rng = np.random.default_rng([27, seed])
    topology, way = TOPOLOGIES[seed % 3], WAYS[seed // 3 % 3]
    N = int(rng.integers(2, 13))
    M = N if topology == "inv" else N + int(rng.integers(0, 4))
    T = 0.3 * rng.standard_normal((M, N)) * (rng.random((M, N)) < 0.8)
    T[:, 0] += 0.2  # no row without an entry
    T[:N] += np.diag(rng.uniform(0.5, 1.5, N)) * (1.0 + 0.3 * math.sqrt(N) * (topology == "inv"))
    gbw = float(10.0 ** rng.uniform(6.0, 8.0))
    opamp: dict[str, Any] = {
        "base": "ideal", "dc_gain": float(10.0 ** rng.uniform(4.0, 7.0)), "gbw": gbw,
        "output_resistance": 0.0,
    }  # fmt: skip
    if rng.random() < 0.5:
        opamp["second_pole"] = gbw * float(10.0 ** rng.uniform(0.0, 1.5))
    if rng.random() < 0.5:
        opamp["input_capacitance"] = float(10.0 ** rng.uniform(-13.0, -11.0))
    design = {
        "topology": topology, "negative_entries": way, "opamp": opamp,
        "unit_conductance": float(10.0 ** rng.uniform(-5.0, -3.5)), "stray_capacitance": 0,
        "strain_input": ("current", "voltage")[int(rng.integers(2))],
        "inverter_resistance": INVERTER,
        **({"lambda": float(10.0 ** rng.uniform(-2.0, 0.0))} if topology == "ridge" else {}),
    }  # fmt: skip
    if topology != "inv":
        factor = float(10.0 ** rng.uniform(-0.5, 1.0))
        design["feedback_conductance"] = design["unit_conductance"] * factor
    problem = {"kind": "matrix", "matrix": T.tolist(), "strain": rng.standard_normal(M).tolist()}
    checks = {"settling_time": {"band": BAND}}
    return make_scene(problem, design=design, checks=checks, analysis={"engine": "statespace"})


def compare_board(seed: int) -> Comparison:
    """Compare every number of the board of a seed with its deck's text."""
    scene = board_scene(seed)
    found, design = verify(scene), scene.design
    numbers = compare(found, true_values(scene))
    outside = tuple(f"{n.name} {n.value!r}" for n in numbers if n.outside)
    stable = bool(found.poles.stable)
    return Comparison(design.topology, design.negative_entries, stable, len(numbers), outside)
