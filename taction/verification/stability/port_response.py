"""Admittance of some parts times the impedance at their terminals, over frequency.

It is the W(s) of the characteristic loci (`loci`): that of equal parts, or of one part that stands
in the matrices as a product of a column and a row. The modes of the board give it at all
frequencies at once: each pole has a residue, and one solve of the equations tells what is left.
The two blocks of a board that is its own mirror image have currents and loci of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.linearised.block_modes import BlockModes
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.state_space import linear_matrices

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
    def count(self) -> int:
        """Number of loci."""
        return len(self.columns.T)

    @property
    def poles(self) -> Complexes:
        """Poles of the board; of a large board those of its coarse board; 1/s."""
        board = self.board.coarse if self.board.descriptor.is_large else self.board
        return board.state_space.modes.poles

    def at(self, omega: Floats) -> list[Complexes]:
        """Return matrices whose eigenvalues are the loci, at omega (P,), 1/s; (P, k, k) each.

        EngineError: the board has a pole there.
        """
        s = np.asarray(1j * omega, np.complex128)
        weights = s[:, None, None] if self.reactive else np.ones(1)
        found = [np.asarray(part.at(s) * weights) for part in self._parts]
        if not found:
            found = [np.stack([self.exact(each) for each in s.tolist()])]
        if not all(np.isfinite(each).all() for each in found):
            raise EngineError("a pole of the board is on the imaginary axis")
        return found

    def exact(self, s: complex) -> Complexes:
        """Return the matrix at s, 1/s, by a solve of the whole equations, shape (K, K).

        EngineError: the board has a pole at s.
        """
        if self.board.descriptor.is_large:
            solved = self.board.structure.factor(s).solve(self.rows.astype(np.complex128))
        else:
            M, K = self._matrices
            X = (s if s.imag else s.real) * M - K
            scale = np.abs(X).max(axis=1, keepdims=True)
            scale[scale == 0.0] = 1.0
            try:
                solved = np.linalg.solve(X / scale, self.rows / scale)
            except np.linalg.LinAlgError:
                raise EngineError("a pole of the board is on the imaginary axis") from None
        return np.asarray(self.columns.T @ solved * (s if self.reactive else 1.0))

    @cached_property
    def _matrices(self) -> tuple[Floats, Floats]:
        dense = linear_matrices(self.board.descriptor, self.board.operating_point)
        return dense.mass, dense.stiffness

    def rate(self, left: Complexes, right: Complexes, s: complex) -> complex:
        """Return ``left d(K - s M) right`` for a relative change of the values, to first order."""
        moved = complex((left @ self.rows) @ (self.columns.T @ right))
        return -s * moved if self.reactive else -moved

    @cached_property
    def _parts(self) -> list[_Part]:
        """The response by the modes of each block of the board; of all where their currents meet.

        Empty for a large board, where modes are not known well, or where more is left than a
        constant: a capacitor at the output of a source has a current that is a derivative.
        """
        if self.board.descriptor.is_large:
            return []
        modes = self.board.state_space.modes
        if not (len(modes.poles) and modes.alone.all() and modes.defect < WELL_CONDITIONED):
            return []
        blocks = modes.refined.blocks
        parts = [part for block in blocks if len((part := self._part([block])).direct)]
        bases = [part.basis for part in parts]
        if parts and np.linalg.matrix_rank(np.hstack(bases)) < sum(len(U.T) for U in bases):
            parts = [self._part(blocks)]
        s = float(np.abs(modes.poles).max()) * np.array([ABOVE, FAR], np.complex128)
        weights = s.real if self.reactive else np.ones(2)
        near, far = (self.exact(each) / by for each, by in zip(s.tolist(), weights, strict=True))
        found, left = list[_Part](), far
        for part in parts:
            U, modal = part.basis, part.at(s)
            direct = U.T @ near @ U - modal[0]
            left = left - U @ (modal[1] + direct) @ U.T
            found.append(replace(part, direct=direct.real))
        size = max(1.0 / weights[1], float(np.abs(far).max()))
        return found if np.abs(left).max() <= WELL_CONDITIONED * size else []

    def _part(self, blocks: Sequence[BlockModes]) -> _Part:
        """Return the response by the modes of some blocks."""
        pencils = [block.reduced.pencil for block in blocks]
        seen = [self.columns.T @ pencil.basis for pencil in pencils]
        driven = [pencil.left @ self.rows for pencil in pencils]
        vectors, sizes, _ = np.linalg.svd(np.hstack(seen))
        U = vectors[:, : int((sizes > SAME * sizes.max(initial=0.0)).sum())]
        right = np.hstack([U.T @ a @ b.V for a, b in zip(seen, blocks, strict=True)])
        left = np.vstack([b.W @ (a @ U) for a, b in zip(driven, blocks, strict=True)])
        residues = right.T[:, :, None] * left[:, None, :]
        poles = np.concatenate([np.diag(block.T) for block in blocks])
        return _Part(U, poles, residues.reshape(len(left), -1), np.zeros((U.shape[1],) * 2))


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Impedance among the currents `basis` (K, k): residues (n, k²) at poles, and what has none."""

    basis: Floats
    poles: Complexes
    residues: Complexes
    direct: Floats

    def at(self, s: Complexes) -> Complexes:
        """Return the impedance at s (P,), 1/s."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (1.0 / (s[:, None] - self.poles)) @ self.residues
        return np.asarray(found.reshape(-1, *self.direct.shape) + self.direct)
