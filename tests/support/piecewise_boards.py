"""Random boards of piecewise linear amplifiers, compared with transients and solvers of others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError, InputError
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients.stepped import SteppedCurve, simulate
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.stability.poles import poles
from taction.verification.verdict.simulation import on_curve, state_space_error
from tests.support.kinked import kinked_transient
from tests.support.random_scenes import random_scene

KINDS = ("deadzone", "rectifier", "saturation")
SHARES = (0.0, 0.5, 1.0)
POINTS = 1001
LIVES, GROWN = 12.0, 3.0  # time constants of a stable board, of an unstable one
TOLERANCE = 1e-7  # of a step
TRUTH = 1e-10  # of the largest voltage: accuracy of the other transient
STIFF = 1e-6  # accuracy of its state matrix over the slowest rate, above which it tells nothing
PROXIMAL = 1e-9  # accuracy of the proximal gradient


class NotComparableError(Exception):
    """The seed has no board, or one whose answer is not unique."""


@dataclass(frozen=True)
class Comparison:
    """One board; `outside` if a number is beyond its bound."""

    amplifier: str
    ridge_share: float
    switches: int
    error: float  # V
    bound: float  # V
    outside: bool

    @property
    def counts(self) -> dict[str, float]:
        """What a study adds up."""
        return {"switches": self.switches}


def board_scene(seed: int) -> Scene:
    """Return the scene of a seed."""
    kind, share = KINDS[seed % 3], SHARES[seed // 3 % 3]
    return random_scene(seed, kind, bias=False, ridge_share=share)


def compare_board(seed: int, points: int = POINTS) -> Comparison:
    """Compare the transient at `points` instants, and the reference's answer, of a random board."""
    scene = board_scene(seed)
    try:
        board = LinearBoard(synthesise(scene))
        found = poles(board)
    except (InputError, EngineError) as error:
        raise NotComparableError(str(error)[:100]) from error
    network = ideal_network(make_problem(scene), scene)
    solution = network.rest
    size = float(np.abs(board.open_loop.A).max())
    stiff = 4.0 * EPS * size / abs(found.rightmost.real)
    if stiff > STIFF:
        raise NotComparableError("too stiff for the other transient")
    stop = (LIVES if found.stable else GROWN) / abs(found.rightmost.real)
    error, record, bound, first = _differences(board, scene, stop, stiff, points)
    outside = first is not None
    if first is not None:  # the other transient misses a stay that is short beside its steps
        outside = _differences(board, scene, first, stiff, points)[3] is not None
    if solution.trusted:
        given = network.T, network.eps, network.lam, KINDS[seed % 3], SHARES[seed // 3 % 3]
        u = proximal(*given)
        step = float(np.abs(u - proximal_step(u, *given)).max())
        if step * _condition(network.T, network.lam, given[-1]) < PROXIMAL / 10.0:  # converged
            gap = float(np.abs(u - solution.u).max())
            outside |= gap > PROXIMAL * (1.0 + float(np.abs(u).max()))
    assert isinstance(record.curve, SteppedCurve)
    switches = len(record.curve.dense.switches) - 1
    return Comparison(KINDS[seed % 3], SHARES[seed // 3 % 3], switches, error, bound, outside)


def _differences(
    board: LinearBoard, scene: Scene, stop: float, stiff: float, points: int
) -> tuple[float, Waveforms, float, float | None]:
    """Return the largest difference, V, the record and its bound, and the first instant outside."""
    times = np.linspace(0.0, stop, points)
    transient = Transient(stop, stop / points, initial=scene.analysis.initial)
    ends = times[[0, -1]]
    first = simulate(board, transient, times=ends, tolerance=TOLERANCE, resolved=True)
    found = state_space_error(board, first)
    truth, doubt, _ = kinked_transient(board, transient, times, board.reported(None))
    size, error = float(np.abs(truth).max()), np.abs(truth - on_curve(found.record, times))
    bound = found.volts + doubt.max() + (TRUTH + stiff) * size
    beyond = times[np.any(error > bound, axis=1)]
    return (
        float(error.max()), found.record, found.volts, float(beyond[0]) if beyond.size else None,
    )  # fmt: skip


def _condition(T: Floats, lam: float, share: float) -> float:
    """Return how many steps of the proximal gradient method its distance from the end may be."""
    curvatures = np.linalg.eigvalsh(T.T @ T) + 0.5 * lam * share
    return float(curvatures[-1] / max(curvatures[0], EPS * curvatures[-1]))


def proximal_step(u: Floats, T: Floats, eps: Floats, lam: float, kind: str, share: float) -> Floats:
    """Return one step of the proximal gradient method for ``|T u - eps|^2 / 2 + lam/2 Omega``."""
    mu = 0.5 * lam
    L = np.linalg.norm(T, 2) ** 2 + mu * share
    z = u - (T.T @ (T @ u - eps) + mu * share * u) / L
    if kind == "deadzone":
        return np.asarray(np.sign(z) * np.maximum(np.abs(z) - mu / L, 0.0))
    return np.maximum(z, 0.0) if kind == "rectifier" else np.clip(z, -1.0, 1.0)


def proximal(T: Floats, eps: Floats, lam: float, kind: str, share: float) -> Floats:
    """Return the minimiser by accelerated proximal gradient steps with restarts."""
    u = y = np.zeros(T.shape[1])
    t = 1.0
    for _ in range(50_000):
        z = proximal_step(y, T, eps, lam, kind, share)
        t = 1.0 if (y - z) @ (z - u) > 0.0 else t
        later = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
        y = z + (t - 1.0) / later * (z - u)
        if np.abs(z - u).max() < 1e-16:
            return z
        u, t = z, later
    return u
