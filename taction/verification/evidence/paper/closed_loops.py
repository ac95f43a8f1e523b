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
    redesigned,
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
    return Chapter((_time(SIZES[:2] if quick else SIZES), _one_pole(), _onset(), _published()))


def _scene(name: str, matrix: Floats, opamp: Mapping[str, Any] = ONE_POLE, **design: Any) -> Scene:
    """Return a shipped scene with another matrix, a strain of ones, and no stray capacitance."""
    problem = {"kind": "matrix", "matrix": matrix.tolist(), "strain": [1.0] * len(matrix)}
    parts = {"unit_conductance": UNIT, "stray_capacitance": 0, "opamp": dict(opamp), **design}
    changes: dict[str, Any] = {"problem": problem, "checks": {}}
    return redesigned(with_values(paper_scene(name), changes), **parts)


def _time(sizes: tuple[int, ...]) -> Finding:
    """Judge ``T_ij = 2^-|i-j|`` with inputs of 1; and less 1/100, in two ways."""

    def slowest(count: int, less: float, way: str) -> float:
        """Return wt times the time constant of the slowest mode of a board of good op-amps."""
        n = np.arange(count)
        matrix = 0.5 ** np.abs(n[:, None] - n[None, :]) - less
        design = {"negative_entries": way, "strain_input": "voltage"}
        scene = _scene("inverse", matrix, ONE_POLE | {"dc_gain": 1e12}, **design)
        return -WT / poles(synthesise(scene)).rightmost.real

    ways = ((0.0, "differential"), (NEGATIVE, "differential"), (NEGATIVE, "offset"))
    free, signed, offset = ([slowest(n, *way) for n in sizes] for way in ways)
    condition = max(free + signed) < END and offset[-1] > GROWN * offset[0]
    values = {"time": free[-1], "signed_time": signed[-1], "offset_time": offset[-1]}
    lists = {"times": free, "signed": signed, "offset": offset, "sizes": list(sizes)}
    return finding("inv-time", weigh(False, condition), **values, **lists)


def _one_pole() -> Finding:
    """Judge every decade of gf, and the energy of the states, whose matrix is diagonal."""
    gfs = [UNIT * 10.0**decade for decade in DECADES]
    found = [poles(synthesise(_scene("least-squares", ROWS, ONE_POLE, **{KNOB: gf}))) for gf in gfs]
    slowest = max(each.rightmost.real for each in found)
    power = max(float(np.linalg.eigvalsh(_power(gf)).max()) for gf in gfs)
    outcome = weigh(all(each.known_stable for each in found) and power < 0.0)
    gfs = [gfs[0], gfs[-1]]
    return finding("pinv-one-pole", outcome, growth_rate=slowest, power=power, gfs=gfs)


def _loads(gf: float) -> Floats:
    return np.append(ROWS.sum(axis=1) * UNIT + gf, ROWS.sum(axis=0) * UNIT)


def _rates(gf: float) -> Floats:
    """Return ``q'`` for the op-amps' output voltages, without their own decay, 1/s."""
    X, (M, N) = ROWS * UNIT, ROWS.shape
    currents = np.block([[-gf * np.eye(M), -X], [X.T, np.zeros((N, N))]])
    return np.asarray(WT * currents / _loads(gf)[:, None])


def _power(gf: float) -> Floats:
    """Return ``(P A + A' P) / 2`` for ``P = diag(loads) / wt``, S: below zero, all modes decay."""
    PA = (_loads(gf) / WT)[:, None] * (_rates(gf) - WT / GAIN * np.eye(sum(ROWS.shape)))
    return np.asarray(0.5 * (PA + PA.T))


def _onset() -> Finding:
    """Judge the least gf with a second pole, by `onset`, the state matrix, and ngspice beside."""
    opamp = ONE_POLE | {"second_pole": 1.0 / (math.tau * LAG)}
    scene = _scene("least-squares", ROWS, opamp, **{KNOB: UNIT})
    edge = onset(scene, over=f"{KNOB}=1uS:10mS").findings[-1]
    exact = float(brentq(_rightmost, 1e-6, 1e-2, xtol=1e-18, rtol=1e-12))
    value, test = edge.crossing.value, edge.confirmation
    if test.confirmed is None:
        raise EngineError(test.reason)
    off = abs(value / exact - 1.0)
    sides = [side.value for side in (test.below, test.above) if side is not None]
    found = {"onset": value, "difference": off, "lag": LAG, "sides": sides, "law": _law()}
    return finding("pinv-onset", weigh(off < CLOSE and test.confirmed), **found)


def _rightmost(gf: float) -> float:
    """Return the rightmost pole of ``q' = wt A o - wp q``, ``LAG o' = q - o``, 1/s."""
    eye = np.eye(sum(ROWS.shape))
    whole = np.block([[-WT / GAIN * eye, _rates(gf)], [eye / LAG, -eye / LAG]])
    return float(np.linalg.eigvals(whole).real.max())


def _law() -> float:
    """Return the least gf of ``c sigma² < gf / (2 wt t2) + gf² d / 4`` with mean loads, S."""
    sigma = float(np.linalg.norm(ROWS * UNIT, 2))
    c = float(np.mean(1.0 / (ROWS.sum(axis=0) * UNIT)))

    def excess(gf: float) -> float:
        d = float(np.mean(1.0 / (ROWS.sum(axis=1) * UNIT + gf)))
        return gf / (2.0 * WT * LAG) + gf**2 * d / 4.0 - c * sigma**2

    return float(brentq(excess, 1e-9, 1.0, rtol=1e-12))


def _published() -> Finding:
    """Random matrices with the conductances, the size and the gf of the published boards."""
    rng = np.random.default_rng(0)
    design = {KNOB: PUBLISHED, "stray_capacitance": "1pF"}
    matrices = (rng.uniform(68e-6, 200e-6, (6, 4)) / UNIT for _ in range(BOARDS))
    found = [poles(synthesise(_scene("least-squares", T, FAST, **design))) for T in matrices]
    unstable = float(sum(each.known_unstable for each in found))
    growth = min(each.rightmost.real for each in found)
    frequency = float(np.median([each.frequency for each in found]))
    values = {"unstable": unstable, "growth_rate": growth, "frequency": frequency}
    return finding("pinv-published", weigh(unstable == 0), **values, boards=BOARDS)
