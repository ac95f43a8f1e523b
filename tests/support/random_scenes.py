"""Random small scenes: over all amplifiers, and of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from taction.netlist_gen.scene.scene import Scene, parse_scene

AMPLIFIERS = ("linear", "exponential", "sinh", "softplus", "tanh")
OPAMPS = ("ideal", "lf353", "lf356", "ne5534", "op27", "tl084", "ua741")
POSITIVE = ("exponential", "softplus")  # outputs
BANDS = (0.002, 0.01, 0.01, 0.05, 0.25)
FEWEST, MOST = 8.0, 500.0  # points a period
SMALLEST, LARGEST = 1e-6, 0.1  # analysis.error
EVERY_OPAMP = ("ua741", "lf353", "tl084", "lf356", "ne5534", "op27", "ideal")
BENT = ("exponential", "exponential", "sinh", "softplus", "tanh")
SIZES = (1, 2, 2, 3, 3, 4, 5, 5, 7, 7, 9, 11, 13, 16)


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
        "opamp": {"base": str(rng.choice(OPAMPS)), "level": "small-signal", "input_errors": "none"},
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


def scene_of_any_kind(seed: int) -> Scene:
    """Return the scene of a seed: of any kind, and one in four unstable or close to onset."""
    rng = np.random.default_rng(seed)
    bent = rng.random() < 0.2
    tables: dict[str, Any] = {
        "name": f"random-{seed}",
        "problem": _matrix_table(rng) if rng.random() < 0.2 else _tactile(rng, 4 if bent else 16),
        "design": _design(rng, bent),
        "checks": _checks(rng),
    }
    if rng.random() < 0.2:
        tables |= {"problem": {"kind": "tactile"}, "design": _breadboard(rng)}
    tables["analysis"] = _analysis(rng, tables["design"]["capacitance"])
    return parse_scene(tables, "scene.toml")


def _some(rng: Generator, share: float, **values: Any) -> dict[str, Any]:
    """Return `values` with the probability `share`, else nothing."""
    return values if rng.random() < share else {}


def _log(rng: Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _pick(rng: Generator, options: tuple[Any, ...]) -> Any:
    return options[int(rng.integers(len(options)))]


def _noise(rng: Generator) -> dict[str, Any]:
    return _some(rng, 0.3, noise={"variance": _log(rng, 1e-6, 1e-2), "seed": 3})


def _tactile(rng: Generator, most: int) -> dict[str, Any]:
    channels = min(_pick(rng, SIZES), most)
    load = {"half_width": float(rng.uniform(0.4, 1.5)), "centre": float(rng.normal(0.0, 0.3))}
    return {
        "kind": "tactile",
        "channels": channels,
        "span": float(rng.uniform(1.0, 8.0)),
        "kernel": _pick(rng, ("normal", "normal", "tangential")),
        "quadrature": _pick(rng, ("none", "rectangle")),
        **_some(rng, 0.5, load=load),
        **_some(rng, 0.2, sensors=channels + 2),
        **_noise(rng),
    }


def _matrix_table(rng: Generator) -> dict[str, Any]:
    shape = int(rng.integers(1, 7)), int(rng.integers(1, 7))
    entries = rng.normal(size=shape) * (rng.random(shape) < 0.8)
    entries[0, 0] = 1.0
    strain = rng.normal(size=shape[0])
    return {"kind": "matrix", "matrix": entries, "strain": strain, **_noise(rng)}


def _breadboard(rng: Generator) -> dict[str, Any]:
    """Return the paper's board with another C, mostly close to its onset at 9.02 pF."""
    slow = {"base": "ideal", "dc_gain": 1e5, "gbw": "718kHz", "second_pole": "2.154MHz"}
    return {
        "capacitance": 9.02e-12 * (1.0 + float(rng.standard_t(1)) ** 2 / 20.0 - 0.02),
        "resistance": "1.9Mohm",
        "opamp": {**slow, "output_resistance": "75ohm", "input_capacitance": "3pF"},
    }


def _design(rng: Generator, bent: bool) -> dict[str, Any]:
    opamp = _pick(rng, EVERY_OPAMP)
    changed = {"base": opamp, "gbw": _log(rng, 3e5, 1e7), "dc_gain": _log(rng, 3e4, 1e6)}
    gain, conductance = _log(rng, 1e5, 2e7), _log(rng, 2e-7, 2e-5)
    regularised = {"lambda": _log(rng, 1e-3, 10.0)}
    topology = _pick(rng, ("integrator", "integrator", "integrator", "passive"))
    if topology == "passive":  # R must compensate what the matrix loads its nodes with
        regularised = {"lambda": _log(rng, 3.0, 30.0) / (gain * conductance)}
    elif rng.random() < 0.3:
        regularised = {"resistance": _log(rng, 1e5, 1e7)}
    amplifier: dict[str, Any] = {"amplifier": "linear"}
    if bent:
        amplifier = {"amplifier": _pick(rng, BENT), "exponential_slope": _log(rng, 0.1, 1.0)}
        amplifier |= {"bias": False} if topology == "passive" else _some(rng, 0.3, bias=False)
    return {
        "topology": topology,
        "capacitance": _log(rng, 5e-12, 1e-9),
        "gain": gain,
        "unit_conductance": conductance,
        "stray_capacitance": _pick(rng, (0.0, 2e-12, 1e-11)),
        "resistor_series": _pick(rng, ("exact", "exact", "E24", "E96")),
        "opamp": changed if rng.random() < 0.4 else opamp,
        **regularised,
        **amplifier,
    }


def _analysis(rng: Generator, capacitance: float) -> dict[str, Any]:
    error = {"error": _log(rng, 1e-6, 1e-2)}
    return {
        "initial": _pick(rng, ("zero", "zero", "rest")),
        **_some(rng, 0.25, stop=capacitance * _log(rng, 1e5, 1e8)),
        **_pick(rng, ({}, {}, error, {"points_per_period": _log(rng, 8.0, 200.0)})),
    }


def _checks(rng: Generator) -> dict[str, Any]:
    band = _log(rng, 1e-3, 0.1)
    rise = {"max": _log(rng, 1e-6, 1e-3), **_some(rng, 0.5, min=_log(rng, 1e-8, 1e-6))}
    return {
        "steady_state": {"tolerance": _log(rng, 3e-4, 0.1)},
        "settling_time": {"band": band, **_some(rng, 0.5, max=_log(rng, 1e-6, 1e-2))},
        **_some(rng, 0.5, rise_time=rise),
        **_some(rng, 0.5, overshoot={"max": _pick(rng, (0.0, 0.01, 0.05, 0.3))}),
        **_some(rng, 0.4, stability={"margin": float(rng.uniform(1.0, 4.0))}),
        **_some(rng, 0.2, engines_agree={"tolerance": _log(rng, 1e-4, 1e-2)}),
    }
