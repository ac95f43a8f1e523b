"""How far the regularised answer is from the true stress, and the board from that answer.

    answer - true stress = (answer without noise - true stress) + (answer - answer without noise)

The first part is regularisation, the second is noise. They add up in each channel, with their
signs; the shares that are stated are those of the channel in which the answer is farthest from the
true stress. Every distance is a fraction of the largest true stress, or of the largest stress of
the answer where no true stress is known.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import SolverError
from taction.verification.reference.dynamics import IdealNetwork
from taction.verification.reference.problem import Solution
from taction.verification.verdict.board import Board
from taction.verification.verdict.checks import Check, Evidence, Outcome
from taction.verification.verdict.input_spread import SHARE
from taction.verification.verdict.run_checks import unconfirmed

DECISIVE = ("headroom", "engines_agree", "same_problem")
"""Checks without which the equilibrium need not be that of the board."""
MOST_SLOPES = 10_000_000  # of outputs with array elements: more would take over 600 MB
ALIKE = 1e-9  # relative difference of errors that count as equal: those of a symmetric board


def worst_channel(errors: Floats) -> int:
    """Return the first channel, from 0, whose error (N,) is the largest but for rounding.

    Examples
    --------
    >>> worst_channel(np.array([0.1, -0.3, 0.3 + 1e-16]))
    1
    """
    sizes = np.abs(errors)
    return int(np.argmax(sizes >= (1.0 - ALIKE) * sizes.max(initial=0.0)))


@dataclass(frozen=True, slots=True)
class BuiltBoards:
    """Where boards of real parts rest, to first order in their deviations."""

    # `distance`, `error`: largest distance of an output from the regularised answer that `SHARE` of
    # the boards keep, and the bound on its error, V; infinite where it is not `known`.
    distance: float
    error: float
    # `least`, `most`: bounds on the share of the boards that rest within the limits of the scene:
    # the tolerance of the steady state, and the band of the settling time. The yield is at most
    # `most`.
    least: float
    most: float
    limit: float  # the smaller one of these limits, a fraction of the step amplitude
    # `varies`, `counted`: what differs between the boards, and what of this the check of the steady
    # state counts.
    varies: str
    counted: str

    @property
    def known(self) -> bool:
        """Whether it is known where they rest; it is not for more than `MOST_SLOPES` slopes."""
        return math.isfinite(self.distance)

    @property
    def covers(self) -> str:
        """What differs between the boards, and what of it the check of the steady state counts."""
        if self.counted == self.varies:
            return self.varies
        last = self.counted.count(", ") + 1
        count = f"only the last{f' {last}' * (last > 1)}" if self.counted else "none of these"
        return f"{self.varies}; the check counts {count}"

    @classmethod
    def of(cls, board: Board, evidence: Evidence) -> BuiltBoards | None:
        """Return the boards of a scene; None where nothing varies that moves their rest."""
        checks, amplitude = evidence.limits, evidence.measurements.amplitude
        limit = min(checks.steady_state.tolerance, checks.settling_time.band)
        elements = sum(int(np.isfinite(each.ohms).sum()) for each in board.circuit.matrices)
        if board.scene.tolerances.resistor and elements * len(board.circuit.outputs) > MOST_SLOPES:
            return cls(math.inf, 0.0, 0.0, 1.0, limit, *board.varies)
        spread = board.built_spread()
        if spread is None:
            return None
        targets, doubt = evidence.targets, evidence.static_error * amplitude
        distance, error = spread.distance(targets)
        least, most = spread.within(targets, limit * amplitude)
        return cls(distance, error + doubt, least, most, limit, *board.varies)


@dataclass(frozen=True, eq=False)
class AnswerError:
    """The errors of an answer, in one unit."""

    DOCUMENT = (
        *("board_error [stress] = shares.board", "board_error_uncertainty [stress] = shares.doubt"),
        "built_error [stress] = shares.built",
        "built_error_uncertainty [stress] = shares.built_doubt",
        "boards = shares.boards # share of the built boards that keep built_error",
        "varies # what differs between the built boards",
        "yield_at_most # bound by the place of rest alone, to first order",
        *("true_error [stress]", "true_error_uncertainty [stress] = shares.true_doubt"),
        *("regularisation [stress]", "noise [stress]", "channel = number # from 1"),
        "largest_stress [V] = unit # the true one; if it is not known, that of the answer",
        "text = verification.report.views.answer_view:answer_text()",
    )

    network: IdealNetwork  # the problem that was solved
    target: Floats  # (N,): its regularised answer, V
    # Bound on the error of `target`, V; infinite where the answer cannot be trusted.
    target_error: float
    stress: Floats | None  # (N,): the true stress as outputs, V; None where it is not known
    step: float = 0.0  # the step amplitude of the network, V; 0 where the board was not compared
    # Largest distance of an output of the board at rest from `target`, V; None for a board that
    # does not come to rest there, or that was not compared.
    board: float | None = None
    board_error: float = 0.0  # bound on the error of `board`, V
    # Where boards of real parts rest; None where nothing varies, or `board` is None.
    built: BuiltBoards | None = None

    @classmethod
    def of(
        cls, network: IdealNetwork, solution: Solution, stress: Floats | None, doubt: str = ""
    ) -> AnswerError:
        """Return the errors of a solution.

        `stress` (N,): the true stress, dimensionless.
        `doubt`: why the solution cannot be trusted, if it is not for its certificate.
        """
        trusted = solution.trusted and not doubt
        error = solution.error_bound * network.U0 if trusted else math.inf
        known = None if stress is None else stress * network.U0
        return cls(network, solution.u * network.U0, error, known)

    def judged(self, evidence: Evidence, checks: Iterable[Check]) -> AnswerError:
        """Return the errors with the distance of the board.

        There is none for a board that does not come to rest, whose record does not confirm where,
        or where another check doubts that the board is the one that was solved.
        """
        if evidence.growth or evidence.obstacle or evidence.unsteady or evidence.unwitnessed:
            return self
        doubts = any(c.name in DECISIVE and c.outcome is not Outcome.PASS for c in checks)
        amplitude = evidence.measurements.amplitude
        distance, error = evidence.static, evidence.static_error
        if doubts or unconfirmed(evidence) or not math.isfinite(distance + error):
            return self
        board, doubt = distance * amplitude, error * amplitude
        return replace(self, step=amplitude, board=board, board_error=doubt)

    @functools.cached_property
    def unit(self) -> float:
        """The voltage of which every error is a fraction, V; 0 if there is no stress at all."""
        return _largest(self.stress) or _largest(self.target)

    @functools.cached_property
    def has_noise(self) -> bool:
        """Whether the strain differs from T times the true stress by more than rounding."""
        if self.stress is None:
            return False
        T, u = self.network.T, self.stress / self.network.U0
        rounding = (len(u) + 4) * EPS * (np.abs(T) @ np.abs(u))
        return bool(np.any(np.abs(self.network.eps - T @ u) > rounding))

    @functools.cached_property
    def clean(self) -> Floats | None:
        """The answer for a strain without noise (N,), V; None if it is not known."""
        if self.stress is None:
            return None
        if not self.has_noise:
            return self.target
        network = self.network
        strain = network.T @ (self.stress / network.U0)
        try:
            solution = replace(network, eps=strain).rest
        except SolverError:
            return None
        return solution.u * network.U0 if solution.trusted else None

    @functools.cached_property
    def channel(self) -> int | None:
        """The channel whose answer is farthest from the true stress, from 0; None: not known."""
        if self.stress is None or math.isinf(self.target_error) or not self.unit:
            return None
        return worst_channel(self.target - self.stress)

    @property
    def number(self) -> int | None:
        """`channel` from 1."""
        return None if self.channel is None else self.channel + 1

    @property
    def shares(self) -> dict[str, float | None]:
        """Distances and their bounds as fractions of `unit`, and the share of built boards."""
        unit, built = self.unit or math.inf, self.built
        return {
            "board": None if self.board is None else self.board / unit,
            "doubt": None if self.board is None else self.board_error / unit,
            "built": None if built is None else built.distance / unit,
            "built_doubt": None if built is None else built.error / unit,
            "boards": None if built is None else SHARE,
            "true_doubt": None if self.channel is None else self.target_error / unit,
        }

    @property
    def varies(self) -> str:
        """What differs between the built boards; empty if nothing does, or it is not known."""
        return "" if self.built is None else self.built.varies

    @property
    def yield_at_most(self) -> float | None:
        """Bound on the yield: the share of the built boards that rest within the limits."""
        return None if self.built is None else self.built.most

    @property
    def true_error(self) -> float | None:
        """Largest distance of the answer from the true stress, of `unit`; None: not known."""
        return self._along(self.target, self.stress)

    @property
    def regularisation(self) -> float | None:
        """What regularisation adds to `true_error` in its channel; below 0: it lowers it."""
        return self._along(self.clean, self.stress)

    @property
    def noise(self) -> float | None:
        """What noise of the strain adds to `true_error` in its channel; below 0: it lowers it."""
        return self._along(self.target, self.clean)

    def _along(self, after: Floats | None, before: Floats | None) -> float | None:
        """Return a difference in the worst channel, positive in the direction of the error."""
        n = self.channel
        if n is None or self.stress is None or after is None or before is None:
            return None
        sign = -1.0 if self.target[n] < self.stress[n] else 1.0
        return sign * float(after[n] - before[n]) / self.unit + 0.0


def _largest(u: Floats | None) -> float:
    return 0.0 if u is None else float(np.abs(u).max(initial=0.0))
