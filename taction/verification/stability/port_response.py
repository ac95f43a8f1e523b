"""Admittance of some parts times the impedance at their terminals, over frequency.

It is the W(s) of the characteristic loci (`loci`): that of equal parts, or of one part that stands
in the matrices as a product of a column and a row. The modes of the board give it at all
frequencies at once: each pole has a residue, and one solve of the equations tells what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.linearised.find_modes import refined_modes
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard

WELL_CONDITIONED = 1e-8  # largest defect of the modes, and error of the response by them
SAME = 1e-9  # of the largest singular value: a smaller one is rounding
ABOVE, FAR = 3.0, 1e3  # of the fastest pole: where solves tell what modes leave, and check it


@dataclass(frozen=True, eq=False)
class PortResponse:
    """Admittance of K parts times the impedance at their terminals.

    With the share c of their values ``s M - K`` is that of the board, and more by
    ``(c - 1) rows columns^T``, times s if the parts stand in M.
    """

    board: LinearBoard  # the board with the parts
    reactive: bool  # whether the parts stand in M, as capacitors do
    # `columns`, `rows`: voltage of each part as a combination of the unknowns; its admittance (or
    # capacitance) in the rows that take up its current.
    columns: Floats
    rows: Floats

    @classmethod
    def of_parts(cls, board: LinearBoard, parts: Sequence[Capacitor | Resistor]) -> PortResponse:
        """Return the response of parts of one kind."""
        descriptor = board.descriptor
        columns = np.zeros((descriptor.size, len(parts)))
        for k, part in enumerate(parts):
            for node, sign in ((part.a, 1.0), (part.b, -1.0)):
                if node != GROUND:
                    columns[descriptor.place(node), k] += sign
        values = [p.farads if isinstance(p, Capacitor) else 1.0 / p.ohms for p in parts]
        rows = np.zeros((descriptor.size + 1, len(parts)))
        np.add.at(rows, descriptor.balance_rows[:-1], columns * values)
        return cls(board, isinstance(parts[0], Capacitor), columns, rows[:-1])

    @classmethod
    def of_law(cls, board: LinearBoard, knob: str) -> PortResponse | None:
        """Return the response of a gain or a coil; None if it is no ``value u v^T`` of a matrix.

        EngineError: the board has no equations.
        """
        doubled = board.circuit.turned(knob, 2.0 * board.circuit.value(knob))
        own, moved = board.descriptor.dense, stamp(doubled).dense
        reactive = not np.array_equal(moved.mass, own.mass)
        change = moved.mass - own.mass if reactive else own.stiffness - moved.stiffness
        i, j = np.unravel_index(int(np.abs(change).argmax()), change.shape)
        rows, columns = change[:, [j]], change[[i]].T / (change[i, j] or 1.0)
        alone = np.allclose(rows @ columns.T, change, rtol=1e-12, atol=0.0)
        return cls(board, reactive, columns, rows) if change[i, j] and alone else None

    @property
    def poles(self) -> Complexes:
        """Poles of the board; of a large board those of its coarse board; 1/s."""
        board = self.board.coarse if self.board.descriptor.is_large else self.board
        return board.state_space.modes.poles

    def at(self, omega: Floats) -> Complexes:
        """Return the matrices whose eigenvalues are the loci, at omega (P,), 1/s; (P, K, K).

        EngineError: the board has a pole there.
        """
        s = np.asarray(1j * omega, np.complex128)
        if self._modal is None:
            found = np.stack([self.exact(each) for each in s.tolist()])
        else:
            poles, residues, direct = self._modal
            weights = s[:, None, None] if self.reactive else 1.0
            found = (_sums(s, poles, residues) + direct) * weights
        if not np.isfinite(found).all():
            raise EngineError("a pole of the board is on the imaginary axis")
        return found

    def exact(self, s: complex) -> Complexes:
        """Return the matrix at s, 1/s, by a solve of the whole equations, shape (K, K).

        EngineError: the board has a pole at s.
        """
        if self.board.descriptor.is_large:
            solved = self.board.structure.factor(s)(self.rows.astype(np.complex128))
        else:
            M, K = self.board.matrices
            X = (s if s.imag else s.real) * M - K
            scale = np.abs(X).max(axis=1, keepdims=True)
            scale[scale == 0.0] = 1.0
            try:
                solved = np.linalg.solve(X / scale, self.rows / scale)
            except np.linalg.LinAlgError:
                raise EngineError("a pole of the board is on the imaginary axis") from None
        return np.asarray(self.columns.T @ solved * (s if self.reactive else 1.0))

    def rate(self, left: Complexes, right: Complexes, s: complex) -> complex:
        """Return ``left d(K - s M) right`` for a relative change of the values, to first order."""
        moved = complex((left @ self.rows) @ (self.columns.T @ right))
        return -s * moved if self.reactive else -moved

    @cached_property
    def _modal(self) -> tuple[Complexes, Complexes, Floats] | None:
        """Poles (n,), residues (n, K, K) and what has no pole (K, K), of the response by the modes.

        None for a large board, where modes are not known well, or where more is left than a
        constant: a capacitor at the output of a source has a current that is a derivative.
        """
        if self.board.descriptor.is_large:
            return None
        modes = self.board.state_space.modes
        if not (len(modes.poles) and modes.alone.all() and modes.defect < WELL_CONDITIONED):
            return None
        modes = refined_modes(modes)
        pencil, poles = modes.reduced.pencil, np.diag(modes.T)
        right = self.columns.T @ pencil.voltages(modes.V)
        left = modes.W @ pencil.unknowns(self.rows)
        residues = right.T[:, :, None] * left[:, None, :]
        s = float(np.abs(modes.poles).max()) * np.array([ABOVE, FAR], np.complex128)
        weights = s.real if self.reactive else np.ones(2)
        near, far = (self.exact(each) / by for each, by in zip(s.tolist(), weights, strict=True))
        modal = _sums(s, poles, residues)
        direct = (near - modal[0]).real
        size = max(1.0 / weights[1], float(np.abs(far).max()))
        known = np.abs(far - modal[1] - direct).max() <= WELL_CONDITIONED * size
        return (poles, residues, direct) if known else None


def _sums(s: Complexes, poles: Complexes, residues: Complexes) -> Complexes:
    """Return the sums of residues (n, K, K) over the distances of s (P,) from poles, (P, K, K)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.tensordot(1.0 / (s[:, None] - poles), residues, 1)
