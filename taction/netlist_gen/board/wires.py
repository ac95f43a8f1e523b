"""Wires of the arrays: a matrix of resistors becomes a crossbar of word lines and bit lines.

Row k of T is word line k, column n is bit line n; every crossing with a resistor is a node of both.
Entries of either sign have an array of their own. Wires have no capacitance, so an array is a
network of resistors between its ports (Kron, 1939). `Crossbar` finds it row by row, the row that is
farthest from the ports of the bit lines first, in sums that do not cancel: with S the conductances
of a row between its bit nodes, seen through its word line, and r the resistance of a bit line's
segment, the currents J of the bit lines at voltages b and word lines' voltages a are

    J = F a - P b,     P <- P + S,    [F, P] <- (1 + r P)^-1 [F, P]

The deck has every wire as a resistor, so ngspice shares none of this.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats

CORNERS = ("top-left", "top-right", "bottom-left", "bottom-right")
STEPS, GAIN = 60, 0.97  # of a compensation, which ends where a step leaves more of its error
LEAST = 0.1  # factor of an entry in a step
ALIKE = 1e-12  # error of the conductances that counts as none, in their norm


@dataclass(frozen=True, slots=True, eq=False)
class Wires:
    """The wires of an array, ohm."""

    word_line: float = 0.0  # per pitch of a row
    bit_line: float = 0.0  # per pitch of a column
    driver: float = 0.0  # between the output of an op-amp and its line
    sense: float = 0.0  # between a line and the input that takes its current
    corner: str = CORNERS[0]  # where the lines have their ports; row 1 is at the top
    # (M, N): the array's resistances over those that it would have without wires
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
        """Return pitches from a word line's port to its crossings, (N,), and a bit line's, (M,)."""
        vertical, _, side = self.corner.partition("-")
        down, along = (np.arange(1.0, count + 1.0) for count in shape)
        return along[:: 1 if side == "left" else -1], down[:: 1 if vertical == "top" else -1]

    def at_ports(self, siemens: Floats, *, by_column: bool) -> PortConductances:
        """Return the conductances between the ports of an array (M, N), S, as `Crossbar` does."""
        return Crossbar(siemens, self).ports().through(*self.terminals(by_column))


@dataclass(frozen=True, slots=True, eq=False)
class PortConductances:
    """An array as conductances between its ports, S, none below zero."""

    across: Floats  # (M, N), between word lines and bit lines: what the array computes with
    words: Floats  # (M, M): among word lines, with zeros on the diagonal
    bits: Floats  # (N, N): among bit lines

    def admittance(self) -> Floats:
        """Return the currents into word, then bit lines over their voltages, (M + N, M + N)."""
        joined = np.block([[self.words, self.across], [self.across.T, self.bits]])
        return np.asarray(np.diag(joined.sum(axis=1)) - joined)

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


class Crossbar:
    """An array (M, N), S, with its lines, but without what is at their ports."""

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
        """Return the voltages of all entries, word to bit line, (M, N, ...), from the ends'."""
        found = np.zeros((*self.siemens.shape, *words.shape[1:]))
        ordered, nodes = words[self.rows], bits
        for row, before, F, P in reversed(list(self._stages())):
            count = before.shape[1]
            nodes = nodes + self.step * (F @ ordered[:count] - P @ nodes)
            found[row] = self._opened(row) @ (ordered[count - 1] - nodes)
        return found


def compensated(siemens: Floats, wires: Wires, *, by_column: bool) -> Floats:
    """Return conductances (M, N), S, with which a wired array has those of `siemens` at its ports.

    Both have the signs of the entries. Every entry is scaled by what lacks at the ports, again and
    again; the result is the closest in the norm of all entries where no conductances have it all.
    """
    signs = [sign for sign in (1.0, -1.0) if np.any(sign * siemens > 0.0)]
    now, best, least = siemens, siemens, np.inf
    for _ in range(STEPS):
        total, own = np.zeros(siemens.shape), np.ones(siemens.shape)
        for sign in signs:
            part = np.maximum(sign * now, 0.0)
            across = wires.at_ports(part, by_column=by_column).across
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
