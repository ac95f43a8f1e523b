"""Wires and devices of the arrays, as data.

With wires a matrix of resistors becomes a crossbar of word lines and bit lines.

Row k of T is word line k, column n is bit line n; every crossing with a resistor is a node of both.
Entries of either sign have an array of their own. Wires have no capacitance, so an array is a
network of resistors between its ports (Kron, 1939). `Crossbar` finds it row by row, the row that is
farthest from the ports of the bit lines first, in sums that do not cancel: with S the conductances
of a row between its bit nodes, seen through its word line, and r the resistance of a bit line's
segment, the currents J of the bit lines at voltages b and word lines' voltages a are

    J = F a - P b,     P <- P + S,    [F, P] <- (1 + r P)^-1 [F, P]

The deck has every wire as a resistor, so ngspice shares none of this.

A `Device` has a window, levels, drift ``g (t/t0)^-nu`` and noise.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

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


MICRO = 1e-6
KINDS = ("programming", "drift", "read_noise")
"""Why a device differs from what it is aimed at, as a standard deviation; in `Device.spreads`."""
LOGARITHMIC = {"drift_exponent", "drift_spread"}  # figures of a device
REPEATS = 60  # of the iteration for what has drifted
FLOOR = 1e-6  # of the largest conductance: what a device without a window keeps


@dataclass(frozen=True, slots=True)
class Logarithmic:
    """A number that falls with the logarithm of x, between two limits; a constant by default."""

    offset: float = 0.0
    slope: float = 0.0
    low: float = -math.inf
    high: float = math.inf

    def at(self, x: Floats) -> Floats:
        """Return it at positive x."""
        return np.clip(self.offset + self.slope * np.log(x), self.low, self.high)


@dataclass(frozen=True, slots=True)
class Device:
    """A device that is programmed to a conductance; its figures have the names of ``[devices]``."""

    least_conductance: float = 0.0  # window of conductances, S
    most_conductance: float = math.inf
    cell_levels: int = 0  # evenly spaced conductances over the window; 0: any
    # coefficients of the polynomial in S, lowest power first, that gives the standard deviation
    # after programming, S
    programming_error: tuple[float, ...] = ()
    read_noise: float = 0.0  # standard deviation from solve to solve, a fraction of the conductance
    # mean of nu, over the conductance in the largest one, or in S
    drift_exponent: Logarithmic = Logarithmic()
    drift_spread: Logarithmic = Logarithmic()  # its standard deviation
    drift_start: float = 1.0  # t0 since its programming, s: no drift up to t0
    age: float = 0.0  # t since its programming, s
    stuck_at_least: float = 0.0  # fractions of the cells that are stuck at the ends of the window
    stuck_at_most: float = 0.0
    source: str = ""  # where the figures were read

    @classmethod
    def in_microsiemens(cls, table: dict[str, Any]) -> Device:
        """Return the device of a table of ``devices.toml``."""
        own = dict(table)
        for name in ("least_conductance", "most_conductance"):
            own[name] *= MICRO
        terms = enumerate(own["programming_error"])
        own["programming_error"] = tuple(MICRO * each / MICRO**power for power, each in terms)
        for name in LOGARITHMIC & own.keys():
            own[name] = Logarithmic(*own[name])
        return cls(**own)

    def settable(self, siemens: Floats) -> Floats:
        """Return the conductances that are aimed at for those that are wanted; zeros stay."""
        low, high = self.least_conductance, self.most_conductance
        aimed = np.clip(siemens, low, high)
        if self.cell_levels:
            step = (high - low) / (self.cell_levels - 1)
            aimed = low + step * np.round((aimed - low) / step)
        return np.where(siemens > 0.0, aimed, 0.0)

    @property
    def stuck(self) -> float:
        """Fraction of the cells that are stuck."""
        return self.stuck_at_least + self.stuck_at_most

    @property
    def decades(self) -> float:
        """``ln(t/t0)``; 0 without drift."""
        return max(math.log(self.age / self.drift_start), 0.0) if self.age else 0.0

    def drifted(self, siemens: Floats) -> Floats:
        """Return what devices have now that had `siemens` when they were programmed; zeros stay."""
        return siemens * self._kept(siemens) if self.decades else siemens

    def programmed_for(self, siemens: Floats) -> Floats:
        """Return what devices had when they were programmed that have `siemens` now."""
        before = siemens
        for _ in range(REPEATS if self.decades else 0):
            before = siemens / self._kept(before)
        return before

    def _kept(self, siemens: Floats) -> Floats:
        """Return the share of programmed conductances that is left."""
        return np.exp(-self.decades * self.drift_exponent.at(self._share(siemens)))

    def _share(self, siemens: Floats) -> Floats:
        unit = self.most_conductance if math.isfinite(self.most_conductance) else 1.0
        return np.where(siemens > 0.0, siemens, unit) / unit

    def spreads(self, siemens: Floats) -> dict[str, Floats]:
        """Return the standard deviations of devices with `siemens` on average, S, by `KINDS`."""
        before, found = self.programmed_for(siemens), dict[str, Floats]()
        if self.programming_error:
            terms = [each * before**power for power, each in enumerate(self.programming_error)]
            kept = np.divide(siemens, before, out=np.zeros_like(siemens), where=before > 0.0)
            found["programming"] = np.maximum(np.sum(terms, axis=0), 0.0) * kept
        if self.decades and self.drift_spread != Logarithmic():
            nu = np.maximum(self.drift_spread.at(self._share(before)), 0.0)
            found["drift"] = siemens * self.decades * nu
        if self.read_noise:
            found["read_noise"] = siemens * self.read_noise
        return found

    def spread(self, siemens: Floats) -> Floats:
        """Return the standard deviation of devices for all reasons together, S."""
        parts = [each**2 for each in self.spreads(siemens).values()]
        return np.sqrt(np.sum(parts, axis=0)) if parts else np.zeros_like(siemens)

    def programmed(self, siemens: Floats, deviations: Floats) -> Floats:
        """Return what devices have that have `siemens` on average, for standard normal deviations.

        The tails of the deviations are the cells that are stuck.
        """
        at_least = at_most = np.zeros(siemens.shape, dtype=np.bool_)
        if self.stuck:
            from scipy.special import ndtr, ndtri

            place = ndtr(deviations)
            at_least, at_most = place < self.stuck_at_least, place > 1.0 - self.stuck_at_most
            inner = (place - self.stuck_at_least) / (1.0 - self.stuck)
            deviations = ndtri(np.where(at_least | at_most, 0.5, inner))
        low, high = self.least_conductance, self.most_conductance
        floor = FLOOR * float(siemens.max(initial=0.0))
        least = np.minimum(siemens, max(float(self.drifted(np.array([low]))[0]), floor))
        found = siemens + deviations * self.spread(siemens)
        found = np.clip(found, least, np.maximum(siemens, high))
        return np.where(at_least, max(low, floor), np.where(at_most, high, found))


@cache
def load_devices() -> dict[str, Device]:
    """Return the devices by name."""
    from importlib.resources import files

    text = files("taction.spice_models").joinpath("devices.toml").read_text("utf-8")
    tables = tomllib.loads(text)["devices"]
    return {name: Device.in_microsiemens(table) for name, table in tables.items()}
