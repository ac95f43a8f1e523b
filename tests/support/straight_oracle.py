"""Readings of boards of straight amplifiers from their deck's text, piece by piece.

The breaks of each B card are where the slope of its printed expression changes. Between two
passages of a break the board is linear: its eigenvalues in Arb give it, and Brent's method the
next passage, on a grid that shows every eigenvalue of the piece. Nothing here is the engine's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from flint import acb_mat, arb, arb_mat
from scipy.optimize import brentq

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.evidence.stress.true_values import TrueValues
from tests.support.deck_equations import parse_deck, state_equations
from tests.support.exact_readings import eigen
from tests.support.nonlinear_response import Board, source_value
from tests.support.oracle import AMPLIFIERS
from tests.support.readings import Samples, read
from tests.support.true_values import _amplified_solution, _precision, board_of

LIVES, PER_RADIAN, MOST_PIECES = 40.0, 12.0, 100
DOUBT = 1e-9  # of the readings, relative or of the step
BEHIND = 1e-13  # of the largest input: a break counts as passed
Floats = np.ndarray


class NotComparableError(Exception):
    """The board does not settle, or has no state equations with delayed amplifiers."""


@lru_cache
def breaks_of(expression: str) -> list[float]:
    """Return where the slope of a B card's expression changes, V."""
    size = np.geomspace(1e-9, 1e4, 401)
    grid = np.concatenate([-size[::-1], size])
    slopes = [float(source_value(expression, x).slope) for x in grid.tolist()]
    found = []
    for k in np.flatnonzero(np.diff(slopes)).tolist():
        low, high = grid[k], grid[k + 1]
        for _ in range(200):
            middle = 0.5 * (low + high)
            same = float(source_value(expression, middle).slope) == slopes[k]
            low, high = (middle, high) if same else (low, middle)
        found.append(0.0 if abs(high) < 1e-30 or low < 0.0 < high else float(high))
    return found


@dataclass
class Stretch:
    """A linear stretch: outputs and inputs are ``rest + Re(rows exp(poles t))``, V."""

    begin: float
    rest: Floats  # (K,)
    poles: Floats  # (n,)
    rows: Floats  # (K, n)
    grid: Floats = field(default_factory=lambda: np.zeros(0))

    def at(self, t: Floats) -> Floats:
        with np.errstate(over="ignore", invalid="ignore"):
            return self.rest + (np.exp(np.outer(t, self.poles)) @ self.rows.T).real


def _grid(poles: Floats) -> Floats:
    """Return instants that show every mode while it lasts, s."""
    parts = [np.zeros(1)]
    for pole in poles:
        last = LIVES / abs(pole.real)
        parts.append(np.arange(1, int(min(last * abs(pole) * PER_RADIAN, 20_000))) / (
            PER_RADIAN * abs(pole)))  # fmt: skip
    return np.unique(np.concatenate(parts))


def _inside(low: float, high: float) -> float:
    """Return a voltage between the ends of a straight piece, V."""
    if np.isfinite(low) and np.isfinite(high):
        return 0.5 * (low + high)
    return low + abs(low) + 1e-3 if np.isfinite(low) else high - abs(high) - 1e-3


def follow(board: Board) -> list[Stretch]:
    """Return the stretches of the transient of one part of a board, from its discharged state."""
    e, k, texts = board.equations, board.outputs, [str(p.value) for p in board.equations.sources]
    n, m = e.A.nrows(), len(texts)
    if any(e.D[k + i, 2 + j] != 0 for i in range(m) for j in range(m)):
        raise NotComparableError("an amplifier reads itself at once")
    breaks, found = [np.array(breaks_of(text)) for text in texts], list[Stretch]()
    x, begin, on = arb_mat(n, 1), 0.0, arb_mat([[1], [1], *([0] for _ in texts)])
    y = [float(v) for v in (e.C * x + e.D * on).entries()[k:]]
    place = [int(np.searchsorted(b, v)) for b, v in zip(breaks, y, strict=True)]
    for _ in range(MOST_PIECES):
        ends = [np.concatenate([[-np.inf], b, [np.inf]]) for b in breaks]
        low, high = (np.array([b[p + s] for b, p in zip(ends, place, strict=True)]) for s in (0, 1))
        inside = list(map(_inside, low.tolist(), high.tolist()))
        duals = [source_value(text, arb(v)) for text, v in zip(texts, inside, strict=True)]
        slopes = arb_mat(2 + m, k + m)
        for i, dual in enumerate(duals):
            slopes[2 + i, k + i] = dual.slope
        shift = [d.value - d.slope * arb(v) for d, v in zip(duals, inside, strict=True)]
        drive = arb_mat([[1], [1], *([v] for v in shift)]) + slopes * e.D * on
        M, c = e.A + e.B * slopes * e.C, e.B * drive
        C, level = e.C + e.D * slopes * e.C, e.D * drive
        try:
            fixed, (poles, V) = M.solve(-c), eigen(M)
            share = V.solve(acb_mat(x - fixed))
        except (ZeroDivisionError, AssertionError) as error:
            raise NotComparableError("no basis of modes") from error
        rows = acb_mat(C) * V
        shown = np.array([[complex(rows[i, j] * share[j, 0]) for j in range(n)]
                          for i in range(k + m)])  # fmt: skip
        rest = np.array([float(v) for v in (C * fixed + level).entries()])
        stretch = Stretch(begin, rest, np.array([complex(p) for p in poles]), shown)
        stretch.grid, first, who, step = _passage(stretch, low, high)
        found.append(stretch)
        if who < 0:
            if stretch.poles.real.max() >= 0.0:
                raise NotComparableError("the board does not settle")
            return found
        grown = [(p * arb(first)).exp() * share[j, 0] for j, p in enumerate(poles)]
        moved = V * acb_mat([[g] for g in grown])
        x = arb_mat([[(fixed[i, 0] + moved[i, 0].real).mid()] for i in range(n)])
        begin += first
        place[who] += step
    raise NotComparableError("the board does not come to rest")


def _passage(stretch: Stretch, low: Floats, high: Floats) -> tuple[Floats, float, int, int]:
    """Return the grid of a stretch, its length, s, which input leaves its piece, and where to."""
    grid, m = _grid(stretch.poles), len(low)
    y = stretch.at(grid)[:, -m:] if m else np.zeros((len(grid), 0))
    finite = np.isfinite(y).all(axis=1)
    grid, y = grid[finite], y[finite]
    room = BEHIND * np.maximum(np.abs(stretch.rest[-m:]), np.abs(y[0])) if m else np.zeros(0)
    first, who, step = np.inf, -1, 0
    for sign, edge in ((1, high), (-1, low)):
        over = sign * (y - edge) > room
        for k in np.flatnonzero(over.any(axis=0)).tolist():
            j, at = int(over[:, k].argmax()), 0.0
            row = len(stretch.rest) - m + k

            def beyond(t: float, row: int = row, k: int = k, sign: int = sign,
                       edge: Floats = edge) -> float:  # fmt: skip
                return float(sign * (stretch.at(np.array([t]))[0, row] - edge[k]) - room[k])

            if j and beyond(grid[j - 1]) < 0.0 < beyond(grid[j]):
                at = float(brentq(beyond, grid[j - 1], grid[j], xtol=1e-300, rtol=1e-15))
            elif j:
                at = float(grid[j])
            if at < first:
                first, who, step = at, k, sign
    return np.append(grid[grid < first], [first] * (who >= 0)), first, who, step


def straight_readings(scene: Scene) -> tuple[TrueValues, int]:
    """Return the true readings of a scene, and the number of passages of breaks."""
    problem, circuit = make_problem(scene), board_of(scene)
    text = write_deck(circuit, OperatingPoint()).text
    unit, count = float(scene.design.unit_voltage), len(circuit.outputs)
    _, targets = _amplified_solution(scene, problem.matrix, problem.strain)
    target = np.array([unit * float(u) for u in targets])
    start = np.full(count, unit * float(AMPLIFIERS[scene.design.amplifier][0](0)))
    amplitude = float(np.abs(target - start).max())
    samples: list[Samples | None] = [None] * count
    final, passages, lead = np.zeros(count), 0, -np.inf + 0j
    with _precision(128):
        boards = [Board(each) for each in state_equations(parse_deck(text))]
        followed = [follow(board) for board in boards]
    for board, stretches in zip(boards, followed, strict=True):
        passages += len(stretches) - 1
        begins = np.array([s.begin for s in stretches])
        last = max(stretches[-1].poles, key=lambda p: (p.real, p.imag))
        lead = max(lead, complex(last), key=lambda p: (p.real, p.imag))
        time = np.concatenate([s.begin + s.grid for s in stretches])
        values = np.concatenate([s.at(s.grid) for s in stretches])
        time, where = np.unique(time, return_index=True)
        for row, channel in enumerate(board.equations.outputs):

            def at(t: float, row: int = row, channel: int = channel, begins: Floats = begins,
                   stretches: list[Stretch] = stretches) -> float:  # fmt: skip
                each = stretches[max(int(np.searchsorted(begins, t, side="right")) - 1, 0)]
                return float(each.at(np.array([t - each.begin]))[0, row] - target[channel])

            final[channel] = stretches[-1].rest[row]
            error = values[where, row] - target[channel]
            samples[channel] = Samples(time, error, at, final[channel] - target[channel])
    band = amplitude * scene.checks.settling_time.band
    channels = []
    for n, each in enumerate(samples):
        assert each is not None
        found = read(each, arb(target[n] - start[n]), arb(amplitude), arb(band))
        channels.append(found | {"final": float(final[n])})
    static = float(np.abs(final - target).max()) / amplitude
    pole = (lead.real, abs(lead.imag))
    return TrueValues(amplitude, pole, static, tuple(channels), DOUBT, "pieces"), passages
