"""The values of a part or of a ``.param`` that a sweep takes: ``NAME=LOW:HIGH:POINTS``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.system.errors import Complaint, InputError
from taction.system.quantities import UNITS

AROUND = 30.0  # range of a value without one
POINTS = 61  # of a range without a number of them
LISTED = 40  # names in a message


@dataclass(frozen=True, slots=True)
class SweptValue:
    """A value to sweep.

    Attributes
    ----------
    name : str
        Of the part, as the deck writes it, or of the ``.param``.
    knob : Knob or None
        Of the part.
    unit : str
        Empty for a plain number.
    own : float or None
        What the part has.
    values : sequence of float
        SI base unit.
    logarithmic : bool
        Whether they are spaced by factors.
    """

    name: str
    knob: Knob | None
    unit: str
    own: float | None
    values: Sequence[float]
    logarithmic: bool

    @classmethod
    def of(
        cls,
        text: str,
        circuit: Circuit,
        parameters: Iterable[str] = (),
        value_of: Callable[[str], float | None] = lambda name: None,
    ) -> SweptValue:
        """Read ``NAME``, ``NAME=LOW:HIGH`` or ``NAME=LOW:HIGH:POINTS``.

        Parameters
        ----------
        parameters : iterable of str
            Names of the ``.param`` cards, in lower case.
        value_of : callable, optional
            Returns the value of one of them, or None.

        Raises
        ------
        InputError
            A name that the board does not have, or a range that is none.

        Examples
        --------
        >>> from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
        >>> flat = read_cards(["v1 in 0 1", "r1 in out 1k", "c1 out 0 1n"])
        >>> found = SweptValue.of("c1=1p:1n:4", circuit_of(flat, "rc", ["out"]))
        >>> found.name, found.own, [f"{value:.0e}" for value in found.values]
        ('C1', 1e-09, ['1e-12', '1e-11', '1e-10', '1e-09'])
        """
        name, _, body = (part.strip() for part in text.partition("="))
        parts = {knob.name.lower(): knob for knob in circuit.knobs if knob.role}
        knob, known = parts.get(name.lower()), tuple(parameters)
        if knob is None and name.lower() not in known:
            listed = ", ".join([*known, *(each.name for each in parts.values())][:LISTED])
            raise InputError("--over", Complaint("name", repr(name), f"expected one of {listed}"))
        own = circuit.value(knob.name) if knob else value_of(name.lower())
        unit = circuit.facts[knob.name].unit if knob else ""
        found = knob.name if knob else name.lower()
        return cls(found, knob, unit, own, *_values(name, text, body, own, unit))


def _values(
    name: str, text: str, body: str, own: float | None, unit: str
) -> tuple[list[float], bool]:
    """Return the values of a range, and whether they are spaced by factors."""
    if body:
        from taction.netlist_gen.scene.axes import range_values
        from taction.netlist_gen.scene.keys import Key

        key = Key(name, "real", unit if unit in UNITS else "ohm")
        found, scale = range_values(key, text, body, POINTS)
        values = [float(value) for value in found]
        return values, scale != "lin" and min(values) > 0.0
    if own is None or not own > 0.0:
        raise InputError("--over", Complaint(name, "", f"expected {name}=LOW:HIGH:POINTS"))
    import numpy as np

    return np.geomspace(own / AROUND, own * AROUND, POINTS).tolist(), True
