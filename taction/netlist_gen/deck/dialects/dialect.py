"""What a dialect is: how it writes the cards of a board, and what follows them.

Every card of a part is written for ngspice first. A dialect turns the few cards that differ into
its own, so a new card of the board needs no change in a dialect that writes it in the same way.
"""

from __future__ import annotations

import re
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

from taction.netlist_gen.analysis import Analysis, SimulatorTolerances, Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.errors import Complaint

NATIVE = "ngspice"
LONGEST = 500  # characters of a line: HSPICE cuts off a line of more than 1024
_EXPRESSION = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True, slots=True)
class DialectRequest:
    """The part of a deck that follows the board.

    Attributes
    ----------
    circuit : Circuit
        The board.
    analysis : Analysis
        The one analysis of the deck.
    saved : tuple of str
        Nodes whose voltages are saved.
    limits : SimulatorTolerances
        They follow from the scales of the board.
    solver : str
        ngspice's option for its matrix solver.
    """

    circuit: Circuit
    analysis: Analysis
    saved: tuple[str, ...]
    limits: SimulatorTolerances
    solver: str


class Dialect(ABC):
    """One language of decks."""

    name: str
    checked: tuple[str, ...] = ()  # comment lines at the head: what checked a deck like this one
    measures: bool = True  # whether the dialect has ``.meas`` and a program that checks it
    parameters: bool = True  # the same of ``.param``

    @abstractmethod
    def refusals(self, circuit: Circuit) -> Iterator[Complaint]:
        """Yield what the dialect cannot express of `circuit`, by the key of the scene."""

    @abstractmethod
    def cards(self, text: str) -> str:
        """Return cards of parts, parameters and measures, given as ngspice has them."""

    @abstractmethod
    def closing(self, request: DialectRequest) -> list[str]:
        """Return options, temperature, saved voltages, the analysis, and the end of the deck."""


class ForeignSpice(Dialect):
    """A SPICE with other words: what LTspice, HSPICE and Xyce share."""

    def refusals(self, circuit: Circuit) -> Iterator[Complaint]:
        """Yield an imported op-amp: its netlist is in a language that taction only passes on."""
        yield from imported_opamps(circuit, self.name)

    def cards(self, text: str) -> str:
        """Return the cards with the behavioural sources and expressions of the dialect."""
        title, _, rest = text.partition("\n")
        lines = [self._card(line) for line in rest.split("\n")]
        if title.startswith(".title"):  # the deck itself, not an included file
            lines = [*(f"* {note}" for note in self.checked), *lines]
        return "\n".join([title, *map(_folded, lines)])

    def closing(self, request: DialectRequest) -> list[str]:
        """Return what follows the board, for a transient."""
        cards = self._transient(request, transient_of(request, self.name))
        return [*map(_folded, cards), ".end", ""]

    def _card(self, line: str) -> str:
        if line.startswith("B"):
            name, node, other, value = line.split(None, 3)
            return self.behavioural(name[1:], node, other, value.partition("=")[2])
        if line.startswith("*"):
            return line
        return _EXPRESSION.sub(lambda found: self.expression(found[1]), line)

    @abstractmethod
    def behavioural(self, name: str, node: str, other: str, value: str) -> str:
        """Return the card of a voltage source with an expression as its value."""

    @abstractmethod
    def _transient(self, request: DialectRequest, transient: Transient) -> list[str]: ...

    def expression(self, text: str) -> str:
        """Return an expression of parameters in the place of a number."""
        return f"{{{text}}}"


def _folded(line: str) -> str:
    """Return a card of at most `LONGEST` characters a line, where it has spaces."""
    if len(line) <= LONGEST or line.startswith("*"):
        return line
    return textwrap.fill(
        line, LONGEST, subsequent_indent="+ ", break_long_words=False, break_on_hyphens=False
    )


def transient_of(request: DialectRequest, dialect: str) -> Transient:
    """Return the transient of `request`.

    Raises
    ------
    ValueError
        Another analysis, or initial voltages: only taction's own studies ask for them.
    """
    analysis = request.analysis
    if not isinstance(analysis, Transient) or analysis.voltages:
        raise ValueError(f"dialect {dialect!r} has transients from zero or rest only")
    return analysis


def starts_from_rest(circuit: Circuit, analysis: Transient) -> bool:
    """Return whether the start needs an operating point; without constant sources rest is 0 V."""
    return analysis.initial == "rest" and circuit.has_constant_sources


def imported_opamps(circuit: Circuit, dialect: str) -> Iterator[Complaint]:
    """Yield the refusal of a vendor's netlist, which is passed on to ngspice only."""
    for model in circuit.models.values():
        if model.imported is not None:
            text = (
                f"a vendor's netlist is written for ngspice only, not for {dialect}; expected a"
                " preset (`taction parts`), or --dialect ngspice"
            )
            yield Complaint("design.opamp.file", repr(model.name), text)


def temperature_of(circuit: Circuit) -> str:
    """Return the temperature of the transistors in degrees C, "" for a board without."""
    return repr(circuit.temperature) if circuit.transistors else ""
