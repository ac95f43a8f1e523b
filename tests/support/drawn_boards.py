"""Synthesised boards of drawn matrices, for tests of large boards."""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.scene import Scene


def drawn_board(seed: int, channels: int = 24, **design: object) -> Circuit:
    """A board with a drawn matrix of drawn shape, op-amp and capacitance; every part has a load."""
    rng = np.random.default_rng(seed)
    sensors = channels + int(rng.integers(-4, 5))
    T = rng.uniform(-1.0, 1.0, (sensors, channels)) * (2.0 / np.sqrt(channels))
    T[rng.uniform(size=T.shape) < 0.3] = 0.0
    asked = {
        "opamp": {"base": str(rng.choice(["tl084", "op27"])), "input_errors": "none"},
        "capacitance": float(rng.choice([1e-9, 2e-10])),
        "gain": float(rng.choice([1e5, 1e6])),
        "lam": 0.1,
        "unit_conductance": "2uS",
        "stray_capacitance": "2pF",
    } | design
    return synthesise(Scene.from_arrays(T, T @ rng.uniform(-1.0, 1.0, channels), **asked))
