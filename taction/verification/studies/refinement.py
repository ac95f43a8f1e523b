"""Refinement: a board of limited accuracy solves again and again for what is left.

A digital computer has T and x in full. Each cycle gives the residual ``r = eps - T x``, scaled
to the full scale of the converter, to the board and adds what it answers: ``x += B r``, with the
answer through a converter, too. The answer is linear in r, ``B r`` with an offset. The error
follows ``e -> (1 - B T) e``: each cycle gains ``-log2 rho(1 - B T)`` bits, until the converters or
the offset let no more through.

Boards are those of a scene whose topology solves ``T u = eps``, with its devices, wires and
op-amps; their matrices are symmetric, positive definite and of given condition numbers, so that
the loop is stable.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import DEVICE, parameters, with_devices_at
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.table import TOPOLOGIES, topology_of
from taction.spice_models.input_errors import MOST
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.results import Result
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.verdict.error_budget import outputs_at_rest

LAST = 200  # cycles: a board that has not arrived then does not


@dataclass(frozen=True, slots=True)
class AnalogSolver:
    """The answer ``B r + offset`` of a board at rest to a strain r, and what it should solve.

    Attributes
    ----------
    T : ndarray (N, N)
        The matrix, as the digital computer has it.
    B : ndarray (N, N)
        u of the board for each strain of 1.
    offset : ndarray (N,)
        u of the board without strain.
    """

    T: Floats
    B: Floats
    offset: Floats

    @property
    def predicted(self) -> float:
        """Bits that a cycle gains by the spectral radius of ``1 - B T``; below 0: it diverges."""
        radius = float(np.abs(np.linalg.eigvals(np.eye(len(self.T)) - self.B @ self.T)).max())
        return -math.log2(radius) if radius > 0.0 else math.inf

    def errors(self, strain: Floats, bits: int, target: int) -> list[float]:
        """Return the error of x after each cycle, over the largest entry of the solution.

        Ends below ``2^-target``, after `LAST` cycles, or where x has no bound.
        """
        solution = np.linalg.solve(self.T, strain)
        size, x = float(np.abs(solution).max()), np.zeros_like(solution)
        scale, found = float(np.abs(strain).max()), list[float]()
        for _ in range(LAST):
            residual = strain - self.T @ x
            largest = float(np.abs(residual).max())
            if largest == 0.0:
                break
            given = scale * converted(residual / largest, bits)
            x = x + largest / scale * in_full_scale(self.B @ given + self.offset, bits)
            found.append(float(np.abs(x - solution).max()) / size)
            if not 2.0**-target <= found[-1] < 1.0 / np.finfo(np.float64).eps:
                break
        return found


def converted(values: Floats, bits: int) -> Floats:
    """Return numbers from -1 to 1 as a converter of so many bits, sign included, has them."""
    steps = 2.0 ** (bits - 1) - 1.0
    return np.asarray(np.round(values * steps) / steps)


def in_full_scale(values: Floats, bits: int) -> Floats:
    """Return numbers as a converter has them whose full scale is the largest of them."""
    largest = float(np.abs(values).max())
    return largest * converted(values / largest, bits) if largest else values


@dataclass(frozen=True, slots=True)
class Refined:
    """Boards with matrices of one condition number.

    Attributes
    ----------
    condition : float
        Largest over smallest singular value of T.
    boards, arrived : int
        How many were drawn, and how many reach the wanted accuracy.
    bits : tuple of float
        Bits gained a cycle by boards that arrive: least, median, most; empty if none does.
    predicted : float
        Median of ``-log2 rho(1 - B T)`` over all boards, bits.
    cycles : float or None
        Median of the cycles of boards that arrive.
    errors : tuple of float
        Median error after each cycle, over the largest entry of the solution, as long as at least
        half of the boards go on.
    """

    condition: float
    boards: int
    arrived: int
    bits: tuple[float, ...]
    predicted: float
    cycles: float | None
    errors: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Refinement(Result):
    """A refinement loop around the boards of a scene.

    Attributes
    ----------
    bits : int
        Of both converters, sign included.
    target : int
        Wanted accuracy: an error of ``2^-target`` of the largest entry of the solution.
    rows : tuple of Refined
        By condition number.
    """

    VIEW = "taction.verification.report.views.refinement:view"
    DOCUMENT = ("scene = scene.name", "channels", "bits", "target", "seed", "rows", "seconds [s]")

    scene: Scene
    channels: int
    bits: int
    target: int
    seed: int
    rows: tuple[Refined, ...]
    seconds: Annotated[float, "s"]

    @property
    def outcome(self) -> str:
        """``pass`` if every board arrives, else ``fail``."""
        return "pass" if all(row.arrived == row.boards for row in self.rows) else "fail"

    def __repr__(self) -> str:
        rows = ", ".join(f"{r.condition:g}: {r.arrived} of {r.boards}" for r in self.rows)
        return f"Refinement({self.scene.name!r}, {self.target} bits; condition {rows} arrive)"


def refinement(
    scene: Scene,
    conditions: Sequence[float],
    *,
    bits: int,
    target: int,
    samples: int,
    seed: int,
    progress: Callable[[str], None],
) -> Refinement:
    """Run the loop on `samples` boards of each condition number.

    Raises
    ------
    InputError
        The boards of the topology do not solve ``T u = eps``.
    """
    if not topology_of(scene).exact:
        exact = " or ".join(repr(name) for name, each in TOPOLOGIES.items() if each.exact)
        text = f"refinement needs a board that solves T u = eps: expected {exact}"
        raise InputError(scene.file, Complaint("design.topology", scene.design.topology, text))
    start, count, rows = time.perf_counter(), len(make_problem(scene).strain), list[Refined]()
    for place, condition in enumerate(conditions):
        progress(f"condition number {condition:g}")
        rng = np.random.default_rng([seed, place])
        tracks, expected = [], []
        for _ in range(samples):
            solver = analog_solver(scene, matrix_of(condition, count, rng), rng)
            expected.append(solver.predicted)
            tracks.append(solver.errors(rng.uniform(-1.0, 1.0, count), bits, target))
        rows.append(_summary(condition, tracks, expected, target))
    seconds = time.perf_counter() - start
    return Refinement(scene, count, bits, target, seed, tuple(rows), seconds)


def matrix_of(condition: float, count: int, rng: np.random.Generator) -> Floats:
    """Return a random symmetric positive definite matrix of a condition number, (N, N)."""
    directions, _ = np.linalg.qr(rng.standard_normal((count, count)))
    values = np.geomspace(1.0, 1.0 / condition, count)
    T = (directions * values) @ directions.T
    return np.asarray(T / np.abs(T).max())


def analog_solver(scene: Scene, T: Floats, rng: np.random.Generator) -> AnalogSolver:
    """Return what the board of a scene with the matrix T answers, with devices that are drawn.

    Op-amps have no limits here. Costs one factorisation, and the equations for each channel.
    """
    N = len(T)
    changes: dict[str, Any] = {
        "problem": {"kind": "matrix", "matrix": T.tolist(), "strain": [1.0] * N},
        "checks": {},
        "design.opamp.level": "small-signal",
    }
    own = with_values(scene, changes)
    problem = make_problem(own)
    nominal = synthesise(own, problem)
    names = [part.name for part in parameters(nominal, own.tolerances) if part.kind == DEVICE]
    devices = dict(zip(names, rng.standard_normal(len(names)) / MOST, strict=True))
    board = LinearBoard(with_devices_at(nominal, devices))
    sensitivity, start = RestSensitivity.of(board), outputs_at_rest(board)
    columns = []
    for more in np.eye(N):
        circuit = synthesise(own, replace(problem, strain=problem.strain + more))
        columns.append(sensitivity.towards(with_devices_at(circuit, devices)))
    B = np.array(columns).T
    unit = nominal.value("U0")
    return AnalogSolver(T, B / unit, (start - B.sum(axis=1)) / unit)


def _summary(
    condition: float, tracks: list[list[float]], expected: list[float], target: int
) -> Refined:
    done = [track for track in tracks if track and track[-1] < 2.0**-target]
    gains = [-math.log2(track[-1]) / len(track) for track in done if track[-1] > 0.0]
    bits = tuple(float(np.quantile(gains, share)) for share in (0.0, 0.5, 1.0)) if gains else ()
    cycles = float(np.median([len(track) for track in done])) if done else None
    longest = max(map(len, tracks), default=0)
    medians = list[float]()
    for k in range(longest):
        there = [track[k] for track in tracks if len(track) > k]
        if 2 * len(there) < len(tracks):
            break
        medians.append(float(np.median(there)))
    predicted = float(np.median(expected))
    return Refined(condition, len(tracks), len(done), bits, predicted, cycles, tuple(medians))
