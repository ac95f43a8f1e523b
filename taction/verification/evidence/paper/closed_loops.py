"""Boards of one loop (INV, PINV) of today's literature: what is said of them, and what holds.

The state matrices are written here from Kirchhoff's laws, with numpy alone: an op-amp has
``q' = wt (v+ - v-) - wp q``, and the voltage at an input is the mean of all that ends there,
weighted with the conductances. A second pole is a lag ``t2 o' = q - o`` behind it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    weigh,
)
from taction.verification.stability.poles import poles
from taction.verification.studies.onset.onset import onset

UNIT, GBW, GAIN, LAG = 1e-4, 1e7, 1e5, 8e-9  # S, Hz, 1, s
ONE_POLE = {"base": "ideal", "dc_gain": GAIN, "gbw": GBW, "output_resistance": 0.0}
FAST = {"base": "opa2134", "gbw": 16e6}  # as fast as an AD823
WT = math.tau * GBW
KNOB = "feedback_conductance"
ROWS = np.array([[1.0, 0.3, 0.2], [0.3, 1.2, 0.3], [0.1, 0.3, 1.1], [0.5, 0.2, 0.4]])
SIZES, NEGATIVE = (8, 32, 128), 0.01
GROWN = 2.0  # at least so much slower is the largest board with an offset column
END = 12.0  # of wt tau as N grows: (1/3) / (3 + 1) is the least eigenvalue
DECADES = range(-4, 5)  # of gf, around the unit conductance
PUBLISHED, BOARDS = 1e-6, 10  # S, of gf; number of boards
CLOSE = 1e-6  # largest relative difference of two values of the onset


def closed_loops(quick: bool) -> Chapter:
    """Judge the time of INV, and the stability of PINV with one pole, with two, and at 1 uS."""
    sizes = SIZES[:2] if quick else SIZES
    return Chapter((_time(sizes), _one_pole(), _onset(), _published()))


def _scene(name: str, matrix: Floats, opamp: Mapping[str, Any] = ONE_POLE, **design: Any) -> Scene:
    """Return a shipped scene with another matrix, a strain of ones, and no stray capacitance."""
    problem = {"kind": "matrix", "matrix": matrix.tolist(), "strain": [1.0] * len(matrix)}
    parts = {"unit_conductance": UNIT, "stray_capacitance": 0, "opamp": dict(opamp), **design}
    changes = {"problem": problem, "checks": {}, **{f"design.{k}": v for k, v in parts.items()}}
    return with_values(paper_scene(name), changes)


def _time(sizes: tuple[int, ...]) -> Finding:
    """Judge ``T_ij = 2^-|i-j|`` with inputs of 1; and less 1/100, in two ways."""
    free = [_slowest(_decaying(n), "differential") for n in sizes]
    signed = [_slowest(_decaying(n) - NEGATIVE, "differential") for n in sizes]
    offset = [_slowest(_decaying(n) - NEGATIVE, "offset") for n in sizes]
    condition = max(free + signed) < END and offset[-1] > GROWN * offset[0]
    values = {"time": free[-1], "signed_time": signed[-1], "offset_time": offset[-1]}
    lists = {"times": free, "signed": signed, "offset": offset, "sizes": list(sizes)}
    return finding("inv-time", values, weigh(False, condition), **lists)


def _decaying(count: int) -> Floats:
    n = np.arange(count)
    return np.asarray(0.5 ** np.abs(n[:, None] - n[None, :]))


def _slowest(matrix: Floats, way: str) -> float:
    """Return wt times the time constant of the slowest mode of an INV board of good op-amps."""
    design = {"negative_entries": way, "strain_input": "voltage"}
    scene = _scene("inverse", matrix, ONE_POLE | {"dc_gain": 1e12}, **design)
    return -WT / poles(synthesise(scene)).rightmost.real


def _one_pole() -> Finding:
    """Judge every decade of gf, and the energy of the states, whose matrix is diagonal."""
    gfs = [UNIT * 10.0**decade for decade in DECADES]
    found = [poles(synthesise(_scene("least-squares", ROWS, ONE_POLE, **{KNOB: gf}))) for gf in gfs]
    slowest = max(each.rightmost.real for each in found)
    power = max(float(np.linalg.eigvalsh(_power(gf)).max()) for gf in gfs)
    stable = all(each.known_stable for each in found)
    values = {"growth_rate": slowest, "power": power}
    return finding("pinv-one-pole", values, weigh(stable and power < 0.0), gfs=[gfs[0], gfs[-1]])


def _loads(gf: float) -> Floats:
    return np.append(ROWS.sum(axis=1) * UNIT + gf, ROWS.sum(axis=0) * UNIT)


def _bracket(gf: float) -> Floats:
    """Return the currents into the loads of the op-amps' inputs for their output voltages, S."""
    X, (M, N) = ROWS * UNIT, ROWS.shape
    return np.block([[-gf * np.eye(M), -X], [X.T, np.zeros((N, N))]])


def _power(gf: float) -> Floats:
    """Return ``(P A + A' P) / 2`` for ``P = diag(loads) / wt``, S: below zero, all modes decay."""
    A = WT * (_bracket(gf) / _loads(gf)[:, None]) - WT / GAIN * np.eye(sum(ROWS.shape))
    P = np.diag(_loads(gf) / WT)
    return 0.5 * (P @ A + A.T @ P)


def _onset() -> Finding:
    """Judge the least gf with a second pole, by `onset`, the state matrix, and ngspice beside."""
    opamp = ONE_POLE | {"second_pole": 1.0 / (math.tau * LAG)}
    scene = _scene("least-squares", ROWS, opamp, **{KNOB: UNIT})
    found = onset(scene, over=f"{KNOB}=1uS:10mS")
    edge = found.findings[-1]
    value, exact = edge.crossing.value, _edge(LAG)
    difference, test = abs(value / exact - 1.0), edge.confirmation
    if test.confirmed is None:
        raise EngineError(test.reason)
    sides = [side.value for side in (test.below, test.above) if side is not None]
    values = {"onset": value, "difference": difference}
    return finding(
        "pinv-onset",
        values,
        weigh(difference < CLOSE and test.confirmed),
        sides=sides,
        lag=LAG,
        law=_law(LAG),
    )


def _rightmost(gf: float, lag: float) -> float:
    """Return the rightmost pole of ``q' = wt A o - wp q``, ``lag o' = q - o``, 1/s."""
    eye = np.eye(sum(ROWS.shape))
    A = _bracket(gf) / _loads(gf)[:, None]
    whole = np.block([[-WT / GAIN * eye, WT * A], [eye / lag, -eye / lag]])
    return float(np.linalg.eigvals(whole).real.max())


def _edge(lag: float) -> float:
    """Return the least gf of the state matrix, S."""
    return float(brentq(_rightmost, 1e-6, 1e-2, args=(lag,), xtol=1e-18, rtol=1e-12))


def _law(lag: float) -> float:
    """Return the least gf of ``c sigma² < gf / (2 wt t2) + gf² d / 4`` with mean loads, S."""
    sigma = float(np.linalg.norm(ROWS * UNIT, 2))
    c = float(np.mean(1.0 / (ROWS.sum(axis=0) * UNIT)))

    def excess(gf: float) -> float:
        d = float(np.mean(1.0 / (ROWS.sum(axis=1) * UNIT + gf)))
        return gf / (2.0 * WT * lag) + gf**2 * d / 4.0 - c * sigma**2

    return float(brentq(excess, 1e-9, 1.0, rtol=1e-12))


def _published() -> Finding:
    """Random matrices with the conductances, the size and the gf of the published boards."""
    rng = np.random.default_rng(0)
    design = {KNOB: PUBLISHED, "stray_capacitance": "1pF"}
    found = []
    for _ in range(BOARDS):
        matrix = rng.uniform(68e-6, 200e-6, (6, 4)) / UNIT
        found.append(poles(synthesise(_scene("least-squares", matrix, FAST, **design))))
    unstable = sum(each.known_unstable for each in found)
    growth = min(each.rightmost.real for each in found)
    frequency = float(np.median([each.frequency for each in found]))
    values = {"unstable": float(unstable), "growth_rate": growth, "frequency": frequency}
    return finding("pinv-published", values, weigh(unstable == 0), boards=len(found))
