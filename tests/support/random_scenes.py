"""Random small scenes over all amplifiers, and random settings of an analysis."""

from __future__ import annotations

from typing import Any

import numpy as np

from taction.netlist_gen.scene.scene import Scene

AMPLIFIERS = ("linear", "exponential", "sinh", "softplus", "tanh")
OPAMPS = ("ideal", "lf353", "lf356", "ne5534", "op27", "tl084", "ua741")
POSITIVE = ("exponential", "softplus")  # outputs
BANDS = (0.002, 0.01, 0.01, 0.05, 0.25)
FEWEST, MOST = 8.0, 500.0  # points a period
SMALLEST, LARGEST = 1e-6, 0.1  # analysis.error


def random_scene(seed: int, amplifier: str = "linear", **values: Any) -> Scene:
    """Return a scene of 1 to 4 channels and sensors; `values` replace its own."""
    rng = np.random.default_rng([11, seed])
    M, N = (int(n) for n in rng.integers(1, 5, 2))
    T = _matrix(rng, M, N)
    u = rng.standard_normal(N) * (1.0 if amplifier == "linear" else 0.5)
    if amplifier in POSITIVE:
        u = np.abs(u)
    if amplifier == "tanh":
        u = np.clip(u, -0.9, 0.9)
    eps = T @ u + 10.0 ** rng.uniform(-4, -1) * rng.standard_normal(M)
    own: dict[str, Any] = {
        "amplifier": amplifier,
        "capacitance": 10.0 ** rng.uniform(-12, -9.5),
        "lam": 10.0 ** rng.uniform(-3, 0.5),
        "gain": 10.0 ** rng.uniform(4.5, 6.7),
        "unit_conductance": 10.0 ** rng.uniform(-6.7, -4.7),
        "stray_capacitance": float(rng.choice([0.0, 1e-12, 5e-12, 1e-11])),
        # The oracle's equilibrium starts from amplifiers, not from op-amps that slew.
        "opamp": {
            "base": str(rng.choice(OPAMPS)),
            "level": "small-signal",
            "input_errors": "none",
        },
        "topology": "integrator" if rng.random() < 0.9 else "passive",
        "resistor_series": str(rng.choice(["exact", "exact", "exact", "E96", "E24"])),
        "steady_state": {"tolerance": float(10.0 ** rng.uniform(-4, -1))},
        "settling_time": {"band": float(rng.choice(BANDS))},
        "overshoot": {"max": 0.3},
        "undershoot": {"max": 0.3},
        "rise_time": {"channel": int(rng.integers(1, N + 1))},
        "initial": str(rng.choice(["zero", "zero", "rest"])),
    }
    if amplifier != "linear":
        own["exponential_slope"] = float(rng.choice([0.1, 0.5, 1.0]))
        own["bias"] = bool(rng.random() < 0.5)
    return Scene.from_arrays(T, eps, **(own | values))


def random_setting(seed: int) -> dict[str, float]:
    """Return ``error`` or ``points_per_period``, evenly distributed in their logarithms."""
    rng = np.random.default_rng([12, seed])
    if rng.random() < 0.5:
        return {"error": float(10.0 ** rng.uniform(np.log10(SMALLEST), np.log10(LARGEST)))}
    return {"points_per_period": float(np.exp(rng.uniform(np.log(FEWEST), np.log(MOST))))}


def _matrix(rng: np.random.Generator, M: int, N: int) -> np.ndarray:
    """Return a dense, kernel-like, sparse, positive or nearly rank-one matrix, at most 1."""
    kind, dense = rng.integers(6), rng.standard_normal((M, N))
    if kind == 1:
        d = (np.arange(M)[:, None] - np.arange(N)) ** 2 * rng.uniform(0.05, 1.5)
        dense = 1.5 / np.pi * (1 - d) / (1 + d) ** 2
    elif kind == 2:
        dense = np.where(rng.random((M, N)) < 0.5, dense, 0.0)
        if not dense.any():
            dense[0, 0] = 1.0
    elif kind == 3:
        dense = np.abs(dense)
    elif kind == 4:
        dense = np.outer(rng.standard_normal(M), rng.standard_normal(N)) + 1e-3 * dense
    return np.asarray(dense / np.abs(dense).max())
