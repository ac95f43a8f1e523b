"""Wires of the arrays: a matrix of resistors becomes a crossbar of word lines and bit lines.

Row k of T is word line k, column n is bit line n. Every crossing with a resistor is a node of both
lines; between neighbouring crossings a line has its resistance per pitch, and one pitch more
between its first crossing and its port. An op-amp drives its lines through `Wires.driver` and takes
up their current through `Wires.sense`. Entries of either sign have an array of their own, so that a
crossing joins two lines.

Wires have no capacitance, so an array is seen from its ports as a network of resistors between them
(Kron, 1939), which is exact at any time. `Crossbar` finds it row by row, the row that is farthest
from the ports of the bit lines first, in sums that do not cancel: with S the conductances of a row
between its bit nodes, seen through its word line, and r the resistance of a bit line's segment,
the currents J of the bit lines at voltages b and word lines' voltages a are

    J = F a - P b,     P <- P + S,    [F, P] <- (1 + r P)^-1 [F, P]

Without resistance this leaves F and P as they are, so a good wire costs no digits. Every step
solves with a positive definite matrix of N bit lines: M N³ operations. A sparse factorisation of
the 2 M N nodes takes longer, and subtracts conductances of wires that are 10⁵ times those of the
entries.

The deck has every wire as a resistor, so ngspice shares none of this.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.board.preferred_values import nearest
from taction.system.array_types import Floats

if TYPE_CHECKING:
    from taction.netlist_gen.board.circuit import Circuit, ResistorMatrix

CORNERS = ("top-left", "top-right", "bottom-left", "bottom-right")
STEPS, GAIN = 60, 0.97  # of a compensation, which ends where a step leaves more of its error
LEAST = 0.1  # factor of an entry in a step
ALIKE = 1e-12  # error of the conductances that counts as none, in their norm
KEPT = 8  # arrays whose reduction is kept: a budget and a margin ask for the same ones again


@dataclass(frozen=True, slots=True, eq=False)
class Wires:
    """The wires of an array, ohm.

    Attributes
    ----------
    word_line, bit_line : float
        Resistance per pitch of a row and of a column.
    driver, sense : float
        Between the output of an op-amp and its line, and between a line and the input that takes
        its current.
    corner : str
        Where rows and columns have their ports: one of `CORNERS`; row 1 is at the top.
    scale : ndarray (M, N), optional
        The array's resistances over those that it would have without wires.
    """

    word_line: float = 0.0
    bit_line: float = 0.0
    driver: float = 0.0
    sense: float = 0.0
    corner: str = CORNERS[0]
    scale: Floats | None = None

    @property
    def described(self) -> str:
        """What they are, in a line."""
        return (
            f"wires: {self.word_line!r} ohm a pitch of a row (Rfw_k_n, Rbw_k_n), {self.bit_line!r}"
            f" ohm of a column (Rfb_k_n, Rbb_k_n), {self.driver!r} ohm at a driver, {self.sense!r}"
            f" ohm at an input; ports at the {self.corner} corner"
        )

    @property
    def resistances(self) -> tuple[float | str, ...]:
        """What decides how a board works, without `scale`."""
        return self.word_line, self.bit_line, self.driver, self.sense, self.corner

    def terminals(self, by_column: bool) -> tuple[float, float]:
        """Return the resistances at the ports of word and bit lines; columns drive, or rows."""
        return (self.sense, self.driver) if by_column else (self.driver, self.sense)

    def distances(self, shape: tuple[int, int]) -> tuple[Floats, Floats]:
        """Return pitches from a word line's port to its crossings, (N,), and a bit line's, (M,).

        Examples
        --------
        >>> [each.tolist() for each in Wires(corner="bottom-left").distances((2, 3))]
        [[1.0, 2.0, 3.0], [2.0, 1.0]]
        """
        vertical, _, side = self.corner.partition("-")
        down, along = (np.arange(1.0, count + 1.0) for count in shape)
        return along[:: 1 if side == "left" else -1], down[:: 1 if vertical == "top" else -1]

    def at_ports(self, siemens: Floats, *, by_column: bool) -> PortConductances:
        """Return the conductances between the ports of an array (M, N), S, as `Crossbar` does."""
        lines = self.word_line, self.bit_line, self.corner
        found = _at_line_ends(lines, siemens.shape, np.ascontiguousarray(siemens).tobytes())
        return found.through(*self.terminals(by_column))


@dataclass(frozen=True, slots=True, eq=False)
class PortConductances:
    """An array as conductances between its ports, S, none below zero.

    Attributes
    ----------
    across : ndarray (M, N)
        Between word lines and bit lines: what the array computes with.
    words, bits : ndarray (M, M) and (N, N)
        Among word lines and among bit lines, with zeros on the diagonal.
    """

    across: Floats
    words: Floats
    bits: Floats

    def admittance(self) -> Floats:
        """Return the currents into word, then bit lines over their voltages, (M + N, M + N)."""
        joined = np.block([[self.words, self.across], [self.across.T, self.bits]])
        return np.diag(joined.sum(axis=1)) - joined

    def through(self, word: float, bit: float) -> PortConductances:
        """Return them behind a resistance, ohm, at every port of a word line and of a bit line."""
        if word == bit == 0.0:
            return self
        M, N = self.across.shape
        Y, ohms = self.admittance(), np.repeat([word, bit], [M, N])
        joined = -np.linalg.solve(np.eye(M + N) + Y * ohms, Y)
        joined = np.maximum(0.5 * (joined + joined.T), 0.0)
        np.fill_diagonal(joined, 0.0)
        return PortConductances(joined[:M, M:], joined[:M, :M], joined[M:, M:])


@lru_cache(maxsize=KEPT)
def _at_line_ends(
    lines: tuple[float, float, str], shape: tuple[int, int], values: bytes
) -> PortConductances:
    word, bit, corner = lines
    siemens = np.frombuffer(values).reshape(shape)
    return Crossbar(siemens, Wires(word, bit, corner=corner)).ports()


class Crossbar:
    """An array with its lines, but without what is at their ports.

    Parameters
    ----------
    siemens : ndarray (M, N)
        The entries; zero where there is none.
    wires : Wires
        Their lines; `driver` and `sense` do not count here.

    Examples
    --------
    Two segments of 1 ohm and an entry of 2 ohm are in series:

    >>> Crossbar(np.array([[0.5]]), Wires(1.0, 1.0)).ports().across.tolist()
    [[0.25]]
    """

    def __init__(self, siemens: Floats, wires: Wires) -> None:
        along, down = wires.distances(siemens.shape)
        self.siemens, self.step = siemens, wires.bit_line
        self.line = wires.word_line * np.minimum.outer(along, along)
        self.rows: list[int] = np.argsort(-down).tolist()  # farthest from the bit lines' ports

    def _opened(self, row: int) -> Floats:
        """Return the voltages of a row's entries over those between its port and bit nodes."""
        N = len(self.line)
        return np.linalg.inv(np.eye(N) + self.line * self.siemens[row])

    def _stages(self) -> Iterator[tuple[int, Floats, Floats, Floats]]:
        """Yield each row with F before its segment, and F and P behind it."""
        N = len(self.line)
        F, P = np.zeros((N, 0)), np.zeros((N, N))
        for row in self.rows:
            S = self.siemens[row][:, None] * self._opened(row)
            S = 0.5 * (S + S.T)
            before, P = np.concatenate([F, S.sum(axis=1)[:, None]], axis=1), P + S
            F = before
            if self.step:
                both = np.concatenate([before, P], axis=1)
                solved = np.linalg.solve(np.eye(N) + self.step * P, both)
                F, P = solved[:, :-N], solved[:, -N:]
                P = 0.5 * (P + P.T)
            yield row, before, F, P

    def ports(self) -> PortConductances:
        """Return the conductances between the ends of the lines."""
        M, N = self.siemens.shape
        among = np.zeros((M, M))
        for _, before, F, P in self._stages():  # noqa: B007 - the last ones are the array's
            count = before.shape[1]
            among[:count, :count] += self.step * (before.T @ F)
        words, across = np.zeros((M, M)), np.zeros((M, N))
        words[np.ix_(self.rows, self.rows)], across[self.rows] = 0.5 * (among + among.T), F.T
        for mesh in (words, P):
            np.fill_diagonal(mesh, 0.0)
        # What rounding leaves of a conductance that is zero may have any sign.
        return PortConductances(
            np.maximum(across, 0.0), np.maximum(words, 0.0), np.maximum(-P, 0.0)
        )

    def entry_voltages(self, words: Floats, bits: Floats) -> Floats:
        """Return the voltages of all entries, from word to bit line, (M, N, ...).

        `words` (M, ...) and `bits` (N, ...) are the voltages at the ends of the lines.
        """
        found = np.zeros((*self.siemens.shape, *words.shape[1:]))
        ordered, nodes = words[self.rows], bits
        for row, before, F, P in reversed(list(self._stages())):
            count = before.shape[1]
            nodes = nodes + self.step * (F @ ordered[:count] - P @ nodes)
            found[row] = self._opened(row) @ (ordered[count - 1] - nodes)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class SignedArray:
    """The array that a matrix of resistors has for its entries of one sign.

    Attributes
    ----------
    negative : bool
        Whether it is that of the negative entries.
    siemens : ndarray (M, N)
        Its entries; zero where there is none.
    words, bits : tuple of str
        The nodes at which its lines end.
    """

    negative: bool
    siemens: Floats
    words: Sequence[str]
    bits: Sequence[str]


def signed_arrays(matrix: ResistorMatrix) -> Iterator[SignedArray]:
    """Yield the arrays of a matrix, that of the positive entries first; only those with entries."""
    siemens = 1.0 / matrix.ohms
    for negative, drives in ((False, matrix.plus), (True, matrix.minus)):
        here = np.where(matrix.negative == negative, siemens, 0.0)
        if here.any():
            ends = (matrix.sinks, drives) if matrix.by_column else (drives, matrix.sinks)
            yield SignedArray(negative, here, *ends)


def at_ports(matrix: ResistorMatrix) -> tuple[ResistorMatrix, ...]:
    """Return the matrices of resistors between the ports of an array that draw the same currents.

    A matrix without wires is its own. Resistors between two lines of a kind are in a matrix whose
    driving and summing nodes are the same ones.
    """
    if matrix.wires is None:
        return (matrix,)
    found = []
    for array in signed_arrays(matrix):
        ports = matrix.wires.at_ports(array.siemens, by_column=matrix.by_column)
        signs = np.full(matrix.ohms.shape, array.negative)
        found.append(replace(matrix, ohms=_ohms(ports.across), negative=signs, wires=None))
        for nodes, mesh in ((array.words, ports.words), (array.bits, ports.bits)):
            if mesh.any():
                ends = {"plus": tuple(nodes), "minus": ("",) * len(nodes), "sinks": tuple(nodes)}
                none = np.zeros(mesh.shape, dtype=np.bool_)
                mesh = _ohms(np.triu(mesh))
                found.append(
                    replace(matrix, ohms=mesh, negative=none, by_column=True, wires=None, **ends)
                )
    return tuple(found)


def _ohms(siemens: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / siemens)


def wire_branches(matrix: ResistorMatrix) -> Iterator[tuple[str, str, str, float]]:
    """Yield name, both nodes and ohms of every entry of a wired matrix, then of its wires.

    ``Rfw_3_5`` and ``Rfb_3_5`` lead from the crossing of word line 3 and bit line 5 towards the
    ports of both; the nodes at this crossing are ``fw_3_5`` and ``fb_3_5``. A wire of 0 ohm is one
    node.
    """
    wires = matrix.wires or Wires()
    along, down = wires.distances(matrix.ohms.shape)
    word, bit = wires.terminals(matrix.by_column)
    entries, segments = [], []
    for array in signed_arrays(matrix):
        rows, nodes = array.siemens > 0.0, dict[tuple[str, int, int], str]()
        lines = (
            ("w", array.words, rows, along, wires.word_line, word),
            ("b", array.bits, rows.T, down, wires.bit_line, bit),
        )
        for letter, ports, present, distance, pitch, terminal in lines:
            for number, port in enumerate(ports):
                node, before, more = port, 0.0, terminal
                places = np.flatnonzero(present[number])
                for place in places[np.argsort(distance[places])].tolist():
                    k, n = (number, place) if letter == "w" else (place, number)
                    name = f"{letter}_{k + 1}_{n + 1}"
                    ohms = more + pitch * float(distance[place] - before)
                    if ohms:
                        there = f"{matrix.name[1:]}{name}"
                        segments.append((f"{matrix.name}{name}", node, there, ohms))
                        node = there
                    nodes[letter, k, n], before, more = node, float(distance[place]), 0.0
        for k, n in np.argwhere(rows).tolist():
            ends = nodes["w", k, n], nodes["b", k, n]
            drive, sink = reversed(ends) if matrix.by_column else ends
            entries.append(
                (f"{matrix.name}_{k + 1}_{n + 1}", drive, sink, float(matrix.ohms[k, n]))
            )
    yield from entries
    yield from segments


def entry_voltages(matrix: ResistorMatrix, volts: Mapping[str, Floats]) -> Floats:
    """Return the voltages of all entries, from the driving to the summing line, (M, N, k).

    `volts` has those of the nodes at the ports, (k,) each; places without an entry have zeros.
    """
    width = next(iter(volts.values())).shape
    found, wires = np.zeros((*matrix.ohms.shape, *width)), matrix.wires or Wires()
    terminals = wires.terminals(matrix.by_column)
    for array in signed_arrays(matrix):
        ends, nothing = [], np.zeros(width)
        for nodes in (array.words, array.bits):
            ends.append(np.array([volts.get(node, nothing) for node in nodes]))
        lost = wires.at_ports(array.siemens, by_column=matrix.by_column).admittance()
        lost = np.split(lost @ np.concatenate(ends), [len(ends[0])])
        at_lines = (
            end - ohms * amps for end, ohms, amps in zip(ends, terminals, lost, strict=True)
        )
        across = Crossbar(array.siemens, wires).entry_voltages(*at_lines)
        across *= (array.siemens > 0.0).reshape(*matrix.ohms.shape, *(1 for _ in width))
        found += -across if matrix.by_column else across
    return found


def compensated(siemens: Floats, wires: Wires, *, by_column: bool) -> Floats:
    """Return conductances (M, N), S, with which a wired array has those of `siemens` at its ports.

    Both have the signs of the entries; those of either sign have an array of their own. Every entry
    is scaled by what lacks at the ports, again and again. Where no conductances have it all,
    because wires alone take more, or because the neighbours of a small entry give more, or one that
    is zero would be needed, the result is what the steps came closest to, in the norm of all
    entries.

    Examples
    --------
    >>> found = compensated(np.array([[0.25]]), Wires(1.0, 1.0), by_column=True)
    >>> bool(abs(found[0, 0] - 0.5) < 1e-12)
    True
    """
    values = np.ascontiguousarray(siemens).tobytes()
    lines = wires.word_line, wires.bit_line, wires.corner
    return _compensated(lines, wires.terminals(by_column), siemens.shape, values)


@lru_cache(maxsize=KEPT)
def _compensated(
    lines: tuple[float, float, str],
    terminals: tuple[float, float],
    shape: tuple[int, int],
    values: bytes,
) -> Floats:
    siemens = np.frombuffer(values).reshape(shape)
    signs = [sign for sign in (1.0, -1.0) if np.any(sign * siemens > 0.0)]
    now, best, least = siemens, siemens, np.inf
    for _ in range(STEPS):
        total, own = np.zeros(shape), np.ones(shape)
        for sign in signs:
            part = np.maximum(sign * now, 0.0)
            across = _at_line_ends(lines, shape, part.tobytes()).through(*terminals).across
            total += sign * across
            own = np.where(part > 0.0, across, own)
        lacking = siemens - total
        error = float(np.linalg.norm(lacking) / np.linalg.norm(siemens))
        enough = error < ALIKE or not error < GAIN * least
        if error < least:
            best, least = now, error
        if enough:
            break
        now = now * np.maximum(1.0 + np.sign(siemens) * lacking / own, LEAST)
    return best


def with_wires(circuit: Circuit, wires: Wires, *, compensate: bool, series: str) -> Circuit:
    """Return `circuit` with `wires` in every matrix.

    Parameters
    ----------
    compensate : bool
        Whether the resistors are those that give the matrices at the ports; then values of the
        `series` again.
    """
    return replace(
        circuit,
        matrices=tuple(_wired(each, wires, compensate, series) for each in circuit.matrices),
    )


def _wired(matrix: ResistorMatrix, wires: Wires, compensate: bool, series: str) -> ResistorMatrix:
    if not compensate:
        return replace(matrix, wires=wires)
    siemens = np.where(matrix.negative, -1.0, 1.0) / matrix.ohms
    ohms = _ohms(np.abs(compensated(siemens, wires, by_column=matrix.by_column)))
    ohms = nearest(ohms, series)
    scale = np.divide(ohms, matrix.ohms, out=np.ones_like(ohms), where=np.isfinite(ohms))
    return replace(matrix, ohms=ohms, wires=replace(wires, scale=scale))


def without_wires(circuit: Circuit) -> Circuit:
    """Return `circuit` as it would be with ideal wires: without them and their compensation."""
    if all(each.wires is None for each in circuit.matrices):
        return circuit
    return replace(circuit, matrices=tuple(map(_straight, circuit.matrices)))


def _straight(matrix: ResistorMatrix) -> ResistorMatrix:
    scale = None if matrix.wires is None else matrix.wires.scale
    return replace(matrix, wires=None, ohms=matrix.ohms if scale is None else matrix.ohms / scale)
