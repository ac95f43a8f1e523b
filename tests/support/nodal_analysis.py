"""Poles of flat linear cards by modified nodal analysis in rational numbers: every current counts.

Independent of taction: it reads the text of the cards, keeps the whole pencil ``s M - K``, and
finds the polynomial ``det(s M - K)`` exactly, so that its degree, the number of poles, is no
question of rounding. Its roots are found with `DIGITS` digits or more.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from functools import cached_property

from mpmath import mp, mpf

DIGITS = 100
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
    def polynomial(self) -> list[Fraction]:
        """Coefficients of ``det(s M - K)``, lowest power first; empty for a singular pencil."""
        highest = sum(any(row.values()) for row in self.M)
        points = [Fraction(k + 1) * 1000 for k in range(highest + 1)]
        found = _interpolated(points, [self._determinant(s) for s in points])
        while found and found[-1] == 0:
            found.pop()
        return found

    def _determinant(self, s: Fraction) -> Fraction:
        rows: Rows = []
        for mass, pull in zip(self.M, self.K, strict=True):
            row = {k: s * value for k, value in mass.items()}
            for k, value in pull.items():
                row[k] = row.get(k, Fraction(0)) - value
            rows.append({k: value for k, value in row.items() if value})
        result, columns = Fraction(1), list(range(len(rows)))
        while rows:
            at = min(range(len(rows)), key=lambda k: len(rows[k]))
            pivot = rows.pop(at)
            if not pivot:
                return Fraction(0)
            column = min(pivot, key=lambda k: (sum(k in row for row in rows), k))
            place = columns.index(column)
            columns.pop(place)
            value = pivot.pop(column)
            result *= value if (at + place) % 2 == 0 else -value
            for row in rows:
                if column not in row:
                    continue
                factor = row.pop(column) / value
                for k, each in pivot.items():
                    changed = row.get(k, 0) - factor * each
                    if changed:
                        row[k] = changed
                    else:
                        row.pop(k, None)
        return result

    def poles(self) -> list[complex]:
        """Return the finite poles, 1/s, rightmost first."""
        falling = self.polynomial[::-1]
        zero = next((k for k, value in enumerate(self.polynomial) if value), 0)
        found = [mpf(0)] * zero
        if len(falling) - zero > 1:
            found += _roots(falling[: len(falling) - zero])
        return sorted((complex(p) for p in found), key=lambda p: (-p.real, -p.imag))


def _root(value: Fraction) -> Fraction:
    """Return the square root to all digits."""
    found = mp.sqrt(mpf(value.numerator) / value.denominator)
    return Fraction(int(found.man)) * Fraction(2) ** int(found.exp)


def _interpolated(points: list[Fraction], values: list[Fraction]) -> list[Fraction]:
    """Return the coefficients of a polynomial through points, by divided differences."""
    differences = list(values)
    for k in range(1, len(points)):
        for j in range(len(points) - 1, k - 1, -1):
            step = points[j] - points[j - k]
            differences[j] = (differences[j] - differences[j - 1]) / step
    found = [Fraction(0)]
    for point, value in zip(reversed(points), reversed(differences), strict=True):
        higher = [Fraction(0), *found]
        found = [a - point * b for a, b in zip(higher, [*found, Fraction(0)], strict=True)]
        found[0] += value
    return found


def _roots(falling: list[Fraction]) -> list[mpf]:
    """Return the roots of a polynomial, over their geometric mean size."""
    degree = len(falling) - 1
    size = (
        abs(mpf(falling[-1].numerator) / falling[-1].denominator)
        / abs(mpf(falling[0].numerator) / falling[0].denominator)
    ) ** (mpf(1) / degree)
    scaled = [
        mpf(c.numerator) / c.denominator * size ** (degree - k) for k, c in enumerate(falling)
    ]
    scaled = [c / scaled[0] for c in scaled]
    found = mp.polyroots(scaled[::-1], maxsteps=2000, extraprec=4 * mp.prec, asc=True)
    return [size * root for root in found]


def exact_poles(cards: Iterable[str]) -> list[complex]:
    """Return the poles of flat cards, rightmost first."""
    with mp.workdps(DIGITS):
        return Pencil(cards).poles()
