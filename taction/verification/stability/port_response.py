"""Admittance of some parts times the impedance at their terminals, over frequency.

It is the W(s) of the characteristic loci (`loci`): that of equal parts, or of one part that stands
in the matrices as a product of a column and a row. The parts of a board that is its own mirror
image have one W for currents that are even under the exchange, and one for odd ones: without them a
point of a sweep with its margin takes up to 9 % more.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.mirror_symmetry import exchange_bases
from taction.verification.engines.statespace.equations.stamps import stamp_together
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.state_space import (
    StateSpace,
    driven,
    driven_together,
    linear_matrices,
)

WELL_CONDITIONED = 1e-8  # largest defect of the modes that are used for the response


@dataclass(frozen=True, eq=False)
class PortResponse:
    """Admittance of K parts times the impedance at their terminals.

    With the share c of their values ``s M - K`` is that of the board, and more by
    ``(c - 1) rows columns^T``, times s if the parts stand in M.

    Attributes
    ----------
    board : LinearBoard
        The board with the parts.
    reactive : bool
        Whether the parts stand in M, as capacitors do.
    columns, rows : ndarray (size, K)
        Voltage of each part as a combination of the unknowns; its admittance (or capacitance) in
        the rows that take up its current.
    """

    board: LinearBoard
    reactive: bool
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
                    columns[descriptor.place(node), k] = sign
        values = [p.farads if isinstance(p, Capacitor) else 1.0 / p.ohms for p in parts]
        rows = np.zeros((descriptor.size + 1, len(parts)))
        np.add.at(rows, descriptor.balance_rows[:-1], columns * values)
        return cls(board, isinstance(parts[0], Capacitor), columns, rows[:-1])

    @classmethod
    def of_laws(cls, board: LinearBoard, knobs: Sequence[str]) -> list[PortResponse | None]:
        """Return the response of each of some gains and coils, by the name of its knob.

        Its value may stand in the matrices as ``value u v^T``; None if it does not.

        Raises
        ------
        EngineError
            A board has no equations.
        """
        circuit = board.circuit
        doubled = [circuit.turned(knob, 2.0 * circuit.value(knob)) for knob in knobs]
        found = list[PortResponse | None]()
        for there in stamp_together(doubled):
            if isinstance(there, EngineError):
                raise there
            own, moved = board.descriptor.dense, there.dense
            reactive = not np.array_equal(moved.mass, own.mass)
            change = moved.mass - own.mass if reactive else own.stiffness - moved.stiffness
            i, j = np.unravel_index(int(np.abs(change).argmax()), change.shape)
            rows, columns = change[:, [j]], change[[i]].T / (change[i, j] or 1.0)
            alone = np.allclose(rows @ columns.T, change, rtol=1e-12, atol=0.0)
            known = bool(change[i, j]) and alone
            found.append(cls(board, reactive, columns, rows) if known else None)
        return found

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
        """Return the matrices of each of `bases` at angular frequencies (P,), 1/s; (P, k, k) each.

        The eigenvalues of all of them are the loci.
        """
        if not self._modes_suffice:
            whole = np.stack([self.exact(1j * each) for each in omega.tolist()])
            return [basis.T @ whole @ basis for basis in self.bases]
        poles, parts = self._residues
        own, other = (1.0 / (1j * omega[:, None] - p) for p in (poles, poles.conj()))
        # ``R / (s - p) + R* / (s - p*)`` of a pair in real matrices.
        gain, found = np.concatenate([own + other, -1j * (own - other)], axis=1), list[Complexes]()
        for residues, direct in parts:
            pairs = gain.real @ residues + 1j * (gain.imag @ residues)
            response = pairs.reshape(-1, *direct.shape) + direct
            weighted = 1j * omega[:, None, None] * response if self.reactive else response
            found.append(np.asarray(weighted))
        return found

    @cached_property
    def bases(self) -> tuple[Floats, ...]:
        """Orthogonal bases (K, k) of currents that do not meet: even and odd ones, or all.

        Under an exchange of the parts, and of what they are, by that of the board.
        """
        every, small = np.eye(self.count), not self.board.descriptor.is_large
        if self.count == 1 or not small or len(self.board.state_space.blocks) == 1:
            return (every,)
        mirrored = self.columns[self.board.descriptor.mirror]
        alike = (mirrored[:, :, None] == self.columns[:, None]).all(axis=0)
        sizes = np.abs(self.rows).max(axis=0)
        alike &= sizes[:, None] == sizes
        image = alike.argmax(axis=1)
        if not np.all(alike.sum(axis=1) == 1) or np.array_equal(image, np.arange(self.count)):
            return (every,)
        even, odd = (basis / np.linalg.norm(basis, axis=0) for basis in exchange_bases(image))
        return even, odd

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of loci of each of `bases`."""
        return tuple(basis.shape[1] for basis in self.bases)

    def exact(self, s: complex) -> Complexes:
        """Return the matrix at s, 1/s, by a solve of the whole equations, shape (K, K).

        Raises
        ------
        EngineError
            The board has a pole at s.
        """
        if self.board.descriptor.is_large:
            solved = self.board.structure.factor(s).solve(self.rows.astype(np.complex128))
        else:
            dense = linear_matrices(self.board.descriptor, self.board.operating_point)
            X = s * dense.mass - dense.stiffness
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
    def _modes_suffice(self) -> bool:
        """Not so where a capacitor is at the output of a source: its current is a derivative."""
        if self.board.descriptor.is_large:
            return False
        modes = self.board.state_space.modes
        with suppress(EngineError):
            alone = bool(modes.alone.all()) and modes.defect < WELL_CONDITIONED
            return alone and self._reduced is not None
        return False

    @cached_property
    def _reduced(self) -> tuple[Floats, Floats, Floats]:
        """B, C and D of the state space with currents into `rows` as inputs.

        Raises
        ------
        EngineError
            The time derivative of an input would be needed: a capacitor at the output of a source.
        """
        return _of_inputs(driven(*_inputs([self])))

    @cached_property
    def _residues(self) -> tuple[Complexes, list[tuple[Floats, Floats]]]:
        """Poles (m,), one of each pair; of each of `bases` residues, and what has no pole, (k, k).

        Real parts of the residues are above the imaginary parts, (2 m, k²).
        """
        (B, C, D), modes = self._reduced, self.board.state_space.modes
        upper = np.flatnonzero(modes.poles.imag >= 0.0)
        seen, left = self.columns.T @ C @ modes.right[:, upper], modes.left[upper] @ B
        found = list[tuple[Floats, Floats]]()
        for basis in self.bases:
            outer = (basis.T @ seen).T[:, :, None] * (left @ basis)[:, None, :]
            residues = outer.reshape(len(upper), basis.shape[1] ** 2)
            residues[modes.poles[upper].imag == 0.0] *= 0.5
            parts = np.concatenate([residues.real, -residues.imag])
            found.append((parts, basis.T @ self.columns.T @ D @ basis))
        return modes.poles[upper], found


def share_elimination(responses: Sequence[PortResponse]) -> None:
    """Eliminate the unknowns without charge once for all parts of one board, if it is small.

    Each part would do it by itself, at many times the cost of one more column.

    Raises
    ------
    EngineError
        As `PortResponse`, where one of the parts needs the time derivative of an input.
    """
    if len(responses) < 2 or responses[0].board.descriptor.is_large:
        return
    B, C, D = _of_inputs(driven(*_inputs(responses)))
    first = 0
    for each in responses:
        taken = slice(first, first := first + each.count)
        vars(each)["_reduced"] = B[:, taken], C, D[:, taken]


def eliminate_together(responses: Iterable[PortResponse]) -> None:
    """Eliminate the unknowns without charge of several boards together, of those that have none.

    Each has the digits that it has alone. What fails says why where it is asked.
    """
    new = [r for r in responses if "_reduced" not in vars(r) and not r.board.descriptor.is_large]
    with suppress(EngineError):
        for each, space in zip(new, driven_together([_inputs([r]) for r in new]), strict=True):
            if not isinstance(space, EngineError):
                vars(each)["_reduced"] = _of_inputs(space)


def _inputs(
    responses: Sequence[PortResponse],
) -> tuple[Descriptor, Equilibrium | None, Floats]:
    """Return a board with the currents into the rows of its responses as inputs.

    The first two inputs of a state space are steps, here without effect.
    """
    board = responses[0].board
    rows = np.hstack([np.zeros((board.descriptor.size, 2)), *(each.rows for each in responses)])
    return board.descriptor, board.operating_point, rows


def _of_inputs(space: StateSpace) -> tuple[Floats, Floats, Floats]:
    return space.B[:, 2:], space.C, space.D[:, 2:]
