"""Poles of flat linear cards by modified nodal analysis in rational numbers: every current counts.

Independent of taction: it reads the text of the cards, keeps the whole pencil ``s M - K``, and
finds the polynomial ``det(s M - K)`` exactly, so that its degree, the number of poles, is no
question of rounding. Its roots are isolated by flint, each to more digits than a double has.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from functools import cached_property
from math import isqrt

from flint import fmpq, fmpq_mat, fmpq_poly, fmpz_poly

DIGITS = 60  # of a square root
SUFFIXES = {
    "meg": "1e6", "t": "1e12", "g": "1e9", "k": "1e3", "m": "1e-3", "u": "1e-6", "n": "1e-9",
    "p": "1e-12", "f": "1e-15",
}  # fmt: skip
Rows = list[dict[int, Fraction]]


def number(text: str) -> Fraction:
    """Return a SPICE number; numbers with an exponent as the double that they are."""
    for suffix, scale in SUFFIXES.items():
        if text.endswith(suffix) and text[: -len(suffix)].replace(".", "").lstrip("+-").isdigit():
            return Fraction(text[: -len(suffix)]) * Fraction(scale)
    return Fraction(float(text))


class Pencil:
    """``M z' = K z`` of flat cards; z are node voltages, then currents of V, E, H and L."""

    def __init__(self, cards: Iterable[str]) -> None:
        self.words = [card.split() for card in cards]
        self.places: dict[str, int] = {}
        coils: dict[str, Fraction] = {}
        for words in self.words:
            letter = words[0][0]
            if letter != "k":
                for node in words[1 : 5 if letter in "eg" else 3]:
                    self._place(node)
        for words in self.words:
            if words[0][0] in "vehl":
                self._place(f"i({words[0]})")
        self.M: Rows = [{} for _ in self.places]
        self.K: Rows = [{} for _ in self.places]
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
                self._through(a, b, j, Fraction(1))
            elif name[0] == "k":
                one, other = (self.places[f"i({coil})"] for coil in rest[:2])
                henries = number(rest[2]) * _root(coils[rest[0]] * coils[rest[1]])
                self._add(self.M, one, other, henries)
                self._add(self.M, other, one, henries)
            elif name[0] in "veh":
                self._law(j, a, b)
                self._through(a, b, j, Fraction(1))
                if name[0] == "e":
                    c, d = (self._place(node) for node in rest[2:4])
                    self._add(self.K, j, c, -number(rest[4]))
                    self._add(self.K, j, d, number(rest[4]))
                if name[0] == "h":
                    self._add(self.K, j, self.places[f"i({rest[2]})"], -number(rest[3]))

    def _place(self, node: str) -> int:
        return -1 if node == "0" else self.places.setdefault(node, len(self.places))

    def _add(self, matrix: Rows, row: int, column: int, value: Fraction) -> None:
        if row >= 0 and column >= 0:
            matrix[row][column] = matrix[row].get(column, Fraction(0)) + value

    def _pair(self, matrix: Rows, a: int, b: int, c: int, d: int, value: Fraction) -> None:
        for row, out in ((a, 1), (b, -1)):
            for column, sign in ((c, 1), (d, -1)):
                self._add(matrix, row, column, out * sign * value)

    def _law(self, row: int, a: int, b: int) -> None:
        self._add(self.K, row, a, Fraction(1))
        self._add(self.K, row, b, Fraction(-1))

    def _through(self, a: int, b: int, column: int, value: Fraction) -> None:
        self._add(self.K, a, column, -value)
        self._add(self.K, b, column, value)

    @cached_property
    def polynomial(self) -> fmpz_poly:
        """``det(s M - K)`` times a whole number, from its values at as many points as it needs."""
        points = range(1000, 1000 * (sum(any(row.values()) for row in self.M) + 2), 1000)
        found, product = fmpq_poly(), fmpq_poly([1])
        for s in points:  # Newton's divided differences
            value = self._matrix(s).det()
            found += product * ((value - found(s)) / product(s))
            product *= fmpq_poly([-s, 1])
        return found.numer()

    def _matrix(self, s: int) -> fmpq_mat:
        size = len(self.M)
        matrix = fmpq_mat(size, size)
        for i, (mass, pull) in enumerate(zip(self.M, self.K, strict=True)):
            for j in mass.keys() | pull.keys():
                value = s * mass.get(j, Fraction(0)) - pull.get(j, Fraction(0))
                matrix[i, j] = fmpq(value.numerator, value.denominator)
        return matrix

    def poles(self) -> list[complex]:
        """Return the finite poles, 1/s, rightmost first."""
        roots = self.polynomial.complex_roots() if self.polynomial.degree() > 0 else []
        found = [complex(root) for root, times in roots for _ in range(times)]
        return sorted(found, key=lambda p: (-p.real, -p.imag))


def _root(value: Fraction) -> Fraction:
    """Return the square root to `DIGITS` digits."""
    scale = 10 ** (2 * DIGITS)
    return Fraction(isqrt(value.numerator * value.denominator * scale), value.denominator) / (
        10**DIGITS
    )


def exact_poles(cards: Iterable[str]) -> list[complex]:
    """Return the poles of flat cards, rightmost first."""
    return Pencil(cards).poles()
