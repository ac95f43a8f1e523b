"""Admittance of some parts times the impedance at their terminals, over frequency.

It is the W(s) of the characteristic loci (`loci`): that of equal parts, or of one part that stands
in the matrices as a product of a column and a row. The parts of a board that is its own mirror
image have one W for currents that are even under the exchange, and one for odd ones: an
eigenproblem of half the size costs a fifth.
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
from taction.verification.engines.statespace.equations.mirror_symmetry import Halves
from taction.verification.engines.statespace.equations.stamps import stamp_together
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.state_space import (
    StateSpace,
    driven,
    driven_together,
)

WELL_CONDITIONED = 1e-8  # largest defect of the modes that are used for the response


@dataclass(frozen=True, slots=True, eq=False)
class _ModalSum:
    """``sum_i right_i left_i / (s - p_i) + direct`` of K currents and voltages.

    Attributes
    ----------
    poles : ndarray (m,)
        One of each conjugate pair, 1/s.
    shares : ndarray (2 m, K²)
        Of the pairs, real and imaginary.
    direct : ndarray (K, K)
    """

    poles: Complexes
    shares: Floats
    direct: Floats

    @classmethod
    def of(cls, poles: Complexes, right: Complexes, left: Complexes, direct: Floats) -> _ModalSum:
        """Return the sum for ``right`` (K, m) and ``left`` (m, K)."""
        products = right.T[:, :, None] * left[:, None, :]
        shares = products.reshape(len(poles), len(right) * left.shape[1])  # also without poles
        shares[poles.imag == 0.0] *= 0.5
        return cls(poles, np.concatenate([shares.real, -shares.imag]), direct)

    def at(self, omega: Floats) -> Complexes:
        """Return the sums at angular frequencies (P,), 1/s; shape (P, K, K)."""
        own, other = (1.0 / (1j * omega[:, None] - p) for p in (self.poles, self.poles.conj()))
        # ``R / (s - p) + R* / (s - p*)`` of a pair in real matrices.
        gain = np.concatenate([own + other, -1j * (own - other)], axis=1)
        found = gain.real @ self.shares + 1j * (gain.imag @ self.shares)
        return np.asarray(found.reshape(-1, *self.direct.shape) + self.direct)


@dataclass(frozen=True, eq=False)
class PortResponse:
    """Admittance of some parts times the impedance at their terminals.

    Attributes
    ----------
    board : LinearBoard
        The board with the parts.
    parts : tuple of Capacitor, or of Resistor
        K parts of one kind.
    """

    board: LinearBoard
    parts: tuple[Capacitor | Resistor, ...]

    @property
    def count(self) -> int:
        """Number of loci."""
        return len(self.parts)

    @property
    def reactive(self) -> bool:
        """Whether the parts are capacitors."""
        return isinstance(self.parts[0], Capacitor)

    @property
    def proportional(self) -> bool:
        """Whether the matrices grow with the value: not with a resistance."""
        return self.reactive

    @property
    def poles(self) -> Complexes:
        """Poles of the board; of a large board those of its coarse board; 1/s."""
        board = self.board.coarse if self.board.descriptor.is_large else self.board
        return board.state_space.modes.poles

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of loci of even and of odd currents; without an exchange of the parts of all."""
        return tuple(len(each.direct) for each in self._modal) if self._is_modal else (self.count,)

    @property
    def _is_modal(self) -> bool:
        return not self.board.descriptor.is_large and self._modes_suffice

    def at(self, omega: Floats) -> tuple[Complexes, ...]:
        """Return the matrices of each of `sizes` at angular frequencies (P,), 1/s; (P, k, k) each.

        The eigenvalues of all of them are the loci.
        """
        if self._is_modal:
            return tuple(self._weighted(each.at(omega), omega) for each in self._modal)
        return (self._weighted(self._from_solves(omega), omega),)

    def at_zero(self) -> Floats:
        """Return the matrix at the frequency 0 by a solve of the whole equations, shape (K, K).

        Of a small linear board; infinite where it has a pole at 0.
        """
        K = self.board.descriptor.dense.stiffness
        scale = np.abs(K).max(axis=1, keepdims=True)
        scale[scale == 0.0] = 1.0
        try:
            solved = np.linalg.solve(-K / scale, self._rows / scale)
        except np.linalg.LinAlgError:
            return np.full((self.count, self.count), np.inf)
        impedance = (self._columns.T @ solved)[None].astype(np.complex128)
        return np.asarray(self._weighted(impedance, np.zeros(1))[0].real)

    def _weighted(self, impedance: Complexes, omega: Floats) -> Complexes:
        """Return W for an impedance of all parts, or of one part of each pair."""
        count, exchange = impedance.shape[-1], self._exchange
        whole = exchange is None or count == self.count
        roots = self._roots if whole or exchange is None else self._roots[exchange.first[:count]]
        weighted = roots[:, None] * impedance * roots
        return 1j * omega[:, None, None] * weighted if self.reactive else weighted

    @cached_property
    def _modes_suffice(self) -> bool:
        modes = self.board.state_space.modes
        return bool(modes.alone.all()) and modes.defect < WELL_CONDITIONED

    @cached_property
    def _roots(self) -> Floats | Complexes:
        """Square roots of the capacitances or conductances, (K,); imaginary of negative ones."""
        values = [p.farads if isinstance(p, Capacitor) else 1.0 / p.ohms for p in self.parts]
        roots = np.emath.sqrt(np.array(values))
        return np.asarray(roots)

    @cached_property
    def _columns(self) -> Floats:
        """Voltage of each part as a combination of the unknowns, shape (size, K)."""
        columns = np.zeros((self.board.descriptor.size, len(self.parts)))
        for k, part in enumerate(self.parts):
            for node, sign in ((part.a, 1.0), (part.b, -1.0)):
                if node != GROUND:
                    columns[self.board.descriptor.place(node), k] = sign
        return columns

    @cached_property
    def _rows(self) -> Floats:
        """Currents of each part into the rows that take them up."""
        descriptor = self.board.descriptor
        rows = np.zeros((descriptor.size + 1, len(self.parts)))
        np.add.at(rows, descriptor.balance_rows[:-1], self._columns)
        return rows[:-1]

    def rate(self, left: Complexes, right: Complexes, s: complex) -> complex:
        """Return ``left d(K - s M) right`` for a relative change of the value, to first order."""
        weights = self._roots**2 * (-s if self.reactive else 1.0)
        return complex((left @ self._rows * weights) @ (self._columns.T @ right))

    @cached_property
    def _exchange(self) -> Halves | None:
        """The exchange of the parts by that of the board; None without one."""
        if self.board.descriptor.is_large or (halves := self.board.state_space.halves) is None:
            return None
        moved = self._columns[halves[0].mirror]
        alike = (moved[:, :, None] == self._columns[:, None]).all(axis=0)
        alike &= self._roots[:, None] == self._roots
        image = alike.argmax(axis=1)
        if not np.all(alike.sum(axis=1) == 1) or np.array_equal(image, np.arange(len(image))):
            return None
        return Halves.of(image)

    @cached_property
    def _modal(self) -> tuple[_ModalSum, ...]:
        """The impedance; with an exchange that for even, then for odd currents."""
        space, modes, columns = self._driven, self.board.state_space.modes, self._columns.T
        if (exchange := self._exchange) is None or space.halves is None:
            B, C, D = _without_steps(space)
            upper = np.flatnonzero(modes.poles.imag >= 0.0)
            right, left = columns @ C @ modes.right[:, upper], modes.left[upper] @ B
            return (_ModalSum.of(modes.poles[upper], right, left, columns @ D),)
        sums, seen = [], space.halves[0].split_rows(columns[exchange.first], exchange.pairs)
        for half, (block, part) in enumerate(zip(modes.blocks, space.blocks, strict=True)):
            B, D = (exchange.split_rows(each[:, 2:])[half] for each in (part.B, part.D))
            count = len(block.kept)
            right = seen[half] @ part.C @ block.columns()[:, :count]
            left = block.rows()[:count] @ B
            sums.append(_ModalSum.of(block.kept, right, left, seen[half] @ D))
        return tuple(sums)

    @cached_property
    def _driven(self) -> StateSpace:
        """The state space with two steps without effect, then the currents, as inputs.

        Raises
        ------
        EngineError
            The time derivative of an input would be needed: a capacitor at the output of a source.
            (Of the first two inputs it does not count, as these are steps.)
        """
        return driven(*_inputs(self.board, self._rows))

    def _from_solves(self, omega: Floats) -> Complexes:
        structure, rows = self.board.structure, self._rows.astype(np.complex128)
        solved = [structure.factor(1j * each).solve(rows) for each in omega.tolist()]
        return np.asarray(self._columns.T @ np.stack(solved))


@dataclass(frozen=True, eq=False)
class LawResponse(PortResponse):
    """The same for one part that stands in the matrices as ``value u v^T``: a gain, or a coil.

    `knob` is its name, and `doubled` are the equations with twice its value; `parts` is empty.
    """

    knob: str = ""
    doubled: Descriptor | None = None

    @classmethod
    def of(cls, board: LinearBoard, knobs: Sequence[str]) -> list[LawResponse | None]:
        """Return the response of each knob; None if its change of the matrices has not the rank 1.

        Raises
        ------
        EngineError
            A board has no equations.
        """
        circuit = board.circuit
        moved = [circuit.turned(knob, 2.0 * circuit.value(knob)) for knob in knobs]
        found = list[LawResponse | None]()
        for knob, there in zip(knobs, stamp_together(moved), strict=True):
            if isinstance(there, EngineError):
                raise there
            response = cls(board, (), knob, there)
            found.append(response if len(response._change[1]) else None)
        return found

    @property
    def count(self) -> int:
        """Number of loci: the rank of the change."""
        return 1

    @property
    def reactive(self) -> bool:
        """Whether the value stands in M."""
        return self._change[0]

    @property
    def proportional(self) -> bool:
        """Whether the matrices grow with the value."""
        return True

    @cached_property
    def _change(self) -> tuple[bool, Floats, Floats]:
        assert self.doubled is not None  # noqa: S101 - see `of`
        own, there = self.board.descriptor.dense, self.doubled.dense
        in_mass = not np.array_equal(there.mass, own.mass)
        change = there.mass - own.mass if in_mass else own.stiffness - there.stiffness
        i, j = np.unravel_index(int(np.abs(change).argmax()), change.shape)
        if change[i, j] == 0.0:
            return in_mass, np.zeros(0), np.zeros(0)
        u, v = change[:, j], change[i] / change[i, j]
        if not np.allclose(np.outer(u, v), change, rtol=1e-12, atol=0.0):
            return in_mass, np.zeros(0), np.zeros(0)
        return in_mass, u, v

    def rate(self, left: Complexes, right: Complexes, s: complex) -> complex:
        """Return ``left d(K - s M) right`` for a relative change of the value."""
        reactive, u, v = self._change
        return complex((left @ u) * (v @ right) * (-s if reactive else -1.0))

    @cached_property
    def _modes_suffice(self) -> bool:
        """Not so where a capacitor is at the output of the source: its current is a derivative."""
        try:
            return self._driven is not None and super()._modes_suffice
        except EngineError:
            return False

    @cached_property
    def _roots(self) -> Floats | Complexes:
        return np.ones(1)

    @cached_property
    def _columns(self) -> Floats:
        return self._change[2][:, None]

    @cached_property
    def _rows(self) -> Floats:
        return self._change[1][:, None]

    def _from_solves(self, omega: Floats) -> Complexes:
        _, u, v = self._change
        dense = self.board.descriptor.dense
        X = 1j * omega[:, None, None] * dense.mass - dense.stiffness
        scale = np.abs(X).max(axis=2, keepdims=True)
        scale[scale == 0.0] = 1.0
        try:
            solved = np.linalg.solve(X / scale, u[:, None] / scale)
        except np.linalg.LinAlgError:
            raise EngineError("a pole of the board is on the imaginary axis") from None
        return np.asarray((v @ solved)[:, None, :])


def share_modes(responses: Iterable[PortResponse]) -> None:
    """Eliminate the unknowns without charge once for all parts of one linear board.

    Each part would do it by itself, at many times the cost of one more column.
    """
    every = list(responses)
    if not every or every[0].board.descriptor.is_large:
        return
    board = every[0].board
    try:
        space = _driven_by(every)
    except EngineError:  # a law with a capacitor at its source
        every = [each for each in every if each.parts]
        if not every:
            return
        space = _driven_by(every)
    modes, (B, C, D) = board.state_space.modes, _without_steps(space)
    upper = np.flatnonzero(modes.poles.imag >= 0.0)
    poles, seen, left = modes.poles[upper], C @ modes.right[:, upper], modes.left[upper] @ B
    first = 0
    for each in every:
        taken = slice(first, first := first + each.count)
        columns = each._columns.T
        found = _ModalSum.of(poles, columns @ seen, left[:, taken], columns @ D[:, taken])
        vars(each).update(_driven=space, _modal=(found,))


def _driven_by(responses: Sequence[PortResponse]) -> StateSpace:
    """Return the state space of a board with the inputs of all its responses."""
    rows = np.concatenate([each._rows for each in responses], axis=1)
    return driven(*_inputs(responses[0].board, rows))


def _inputs(board: LinearBoard, rows: Floats) -> tuple[Descriptor, Equilibrium | None, Floats]:
    steps = np.zeros((len(rows), 2))
    return board.descriptor, board.operating_point, np.hstack([steps, rows])


def _without_steps(space: StateSpace) -> tuple[Floats, Floats, Floats]:
    return space.B[:, 2:], space.C, space.D[:, 2:]


def share_eliminations(responses: Iterable[PortResponse]) -> None:
    """Eliminate the unknowns without charge of several boards together.

    A response of a large board, or of one that has none from its modes, stays as it is, and says
    why where it is asked.
    """
    ready = dict[PortResponse, tuple[Descriptor, Equilibrium | None, Floats]]()
    for each in responses:
        with suppress(EngineError):
            known = "_driven" in vars(each) or each.board.descriptor.is_large
            if not known and each._modes_suffice:
                ready[each] = _inputs(each.board, each._rows)
    for each, space in zip(ready, driven_together(list(ready.values())), strict=True):
        if not isinstance(space, EngineError):
            vars(each)["_driven"] = space
