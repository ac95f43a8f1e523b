"""Poles of flat linear cards by modified nodal analysis with mpmath: every current is an unknown.

Independent of taction: it reads the text of the cards, keeps the whole pencil ``s M - K``, and
finds its finite eigenvalues at `DIGITS` digits as ``shift + 1/mu`` of ``(K - shift M)^-1 M``.
"""

from __future__ import annotations

from collections.abc import Iterable

import mpmath
from mpmath import mp, mpf

DIGITS = 100
SUFFIXES = {
    "meg": "1e6", "t": "1e12", "g": "1e9", "k": "1e3", "m": "1e-3", "u": "1e-6", "n": "1e-9",
    "p": "1e-12", "f": "1e-15",
}  # fmt: skip


def number(text: str) -> mpf:
    """Return a SPICE number; numbers with an exponent as the double that they are."""
    for suffix, scale in SUFFIXES.items():
        if text.endswith(suffix) and text[: -len(suffix)].replace(".", "").lstrip("+-").isdigit():
            return mpf(text[: -len(suffix)]) * mpf(scale)
    return mpf(float(text))


class Pencil:
    """``M z' = K z`` of flat cards; z are node voltages, then currents of V, E, H and L."""

    def __init__(self, cards: Iterable[str]) -> None:
        self.words = [card.split() for card in cards]
        self.places: dict[str, int] = {}
        coils: dict[str, mpf] = {}
        for words in self.words:
            letter = words[0][0]
            if letter != "k":
                for node in words[1 : 5 if letter in "eg" else 3]:
                    self._place(node)
        for words in self.words:
            if words[0][0] in "vehl":
                self._place(f"i({words[0]})")
        size = len(self.places)
        self.M, self.K = mpmath.zeros(size), mpmath.zeros(size)
        for name, *rest in self.words:
            a, b = (self._place(node) for node in rest[:2]) if name[0] != "k" else (-1, -1)
            j = self.places.get(f"i({name})", -1)
            if name[0] == "r":
                self._pair(self.K, a, b, a, b, -1 / number(rest[2]))
            elif name[0] == "c":
                self._pair(self.M, a, b, a, b, number(rest[2]))
            elif name[0] == "g":
                c, d = (self._place(node) for node in rest[2:4])
                self._pair(self.K, a, b, c, d, -number(rest[4]))
            elif name[0] == "f":
                self._through(a, b, self.places[f"i({rest[2]})"], number(rest[3]))
            elif name[0] == "l":
                coils[name] = number(rest[2])
                self._add(self.M, j, j, coils[name])
                self._law(j, a, b)
                self._through(a, b, j, mpf(1))
            elif name[0] == "k":
                one, other = (self.places[f"i({coil})"] for coil in rest[:2])
                henries = number(rest[2]) * mp.sqrt(coils[rest[0]] * coils[rest[1]])
                self._add(self.M, one, other, henries)
                self._add(self.M, other, one, henries)
            elif name[0] in "veh":
                self._law(j, a, b)
                self._through(a, b, j, mpf(1))
                if name[0] == "e":
                    c, d = (self._place(node) for node in rest[2:4])
                    self._add(self.K, j, c, -number(rest[4]))
                    self._add(self.K, j, d, number(rest[4]))
                if name[0] == "h":
                    self._add(self.K, j, self.places[f"i({rest[2]})"], -number(rest[3]))

    def _place(self, node: str) -> int:
        return -1 if node == "0" else self.places.setdefault(node, len(self.places))

    def _add(self, matrix: mpmath.matrix, row: int, column: int, value: mpf) -> None:
        if row >= 0 and column >= 0:
            matrix[row, column] += value

    def _pair(self, matrix: mpmath.matrix, a: int, b: int, c: int, d: int, value: mpf) -> None:
        for row, out in ((a, 1), (b, -1)):
            for column, sign in ((c, 1), (d, -1)):
                self._add(matrix, row, column, out * sign * value)

    def _law(self, row: int, a: int, b: int) -> None:
        self._add(self.K, row, a, mpf(1))
        self._add(self.K, row, b, mpf(-1))

    def _through(self, a: int, b: int, column: int, value: mpf) -> None:
        self._add(self.K, a, column, -value)
        self._add(self.K, b, column, value)

    def poles(self) -> list[complex]:
        """Return the finite poles, 1/s, rightmost first."""
        scale = mpf(1) / mpf("1e-5")
        shift = mpf("12345.678901") * scale / 1000
        X = mpmath.inverse(self.K - shift * self.M) * self.M
        values = mpmath.eig(X, left=False, right=False)
        largest = max((abs(value) for value in values), default=mpf(0))
        least = max(largest * mpf("1e-30"), mpf("1e-30"))  # a pole of 1e30 /s is at infinity
        finite = [shift + 1 / value for value in values if abs(value) > least]
        return sorted((complex(p) for p in finite), key=lambda p: (-p.real, -p.imag))


def exact_poles(cards: Iterable[str]) -> list[complex]:
    """Return the poles of flat cards, rightmost first."""
    with mp.workdps(DIGITS):
        return Pencil(cards).poles()
