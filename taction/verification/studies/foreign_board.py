"""A deck of another hand as a `Circuit`: expanded by ngspice, with op-amps of vendors replaced.

A vendor's macromodel is a subcircuit with transistors, diodes or expressions and five ports. Each
is imported as `taction parts import` does it: checked, written anew, measured by ngspice, and
replaced by its linear model; the transient of ngspice keeps the macromodel itself.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.branches import Coil, Source, VoltageBetween
from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import Branch, OpAmpCell
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.deck.flat_cards import (
    MODEL,
    CardError,
    Flat,
    circuit_of,
    outputs_of,
    read_cards,
    stepped,
)
from taction.netlist_gen.deck.foreign_deck import (
    LINEAR,
    ForeignDeck,
    read_deck,
    table,
    unbraced_expression,
)
from taction.netlist_gen.deck.ltspice import missing_cards
from taction.netlist_gen.deck.macromodels import (
    PINS,
    RAILS,
    cards_of_models,
    ltspice_opamps,
    vendors_of,
    with_own_parameters,
    with_stubs,
)
from taction.netlist_gen.deck.stimuli import FIXED
from taction.netlist_gen.deck.unanswered_cards import unanswered, with_first_steps
from taction.spice_models.foreign_expressions import number
from taction.spice_models.imported import ROLES, ImportedOpAmp
from taction.spice_models.opamp import OpAmp
from taction.system.errors import Complaint, DidNotLoad, InputError, SimulationError, one_line
from taction.system.frozen import frozen
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.listing import expand, expand_and_wait
from taction.verification.engines.ngspice.process import Run

MOST_UNKNOWNS = 600  # of a deck: above it the engine needs the structure of a topology
RELATIVE = 1e-6  # reltol of the witness
EDGE = 0.01  # of the first step: the edge of a step in ngspice
PROBE = "v_taction_parameter"  # a source whose value is that of a .param
_TEMPERATURE = re.compile(r"^\.(?:temp|opt\w* (?:.* )?(?:temp|tnom) ?=) ?(\S+)")
_CHARGE = re.compile(r"\bic\s*=\s*\S+")  # which does not count
Start = Literal["zero", "rest"]
Supplied = tuple[int, int, float, float]
"""Number of a vendor's subcircuit, that of the order of its ports, and its V- and V+."""
ORDERS = (ROLES, (*ROLES[:2], ROLES[4], *ROLES[2:4]))
"""Orders of the ports + - V+ V- out, and of those with out before the supplies."""


@frozen(eq=False, slots=False)
class ForeignBoard:
    """A deck that has been read.

    Attributes
    ----------
    deck : ForeignDeck
        Its text.
    flat : Flat
        Its flat cards.
    circuit : Circuit
        The board: every part is a knob.
    initial : str
        ``"zero"`` for a transient with ``uic``, else ``"rest"``.
    notes : tuple of str
        What was done with the deck: the step, op-amps that were replaced, what was left out.
    opamps : mapping of str to ImportedOpAmp
        The macromodels that linear models replace.
    run : Run or None
        ngspice, which waits for the deck of its transient.
    """

    deck: ForeignDeck
    flat: Flat
    circuit: Circuit
    initial: Start
    notes: tuple[str, ...]
    opamps: Mapping[str, ImportedOpAmp] = field(default_factory=dict)
    lines: tuple[str, ...] = ()  # as ngspice expands them: the cards, with stubs for op-amps
    linearise: bool = False
    supplied: Mapping[Supplied, str] = field(default_factory=dict)  # names of the models
    run: Run | None = None

    def witness(self, transient: Transient, solver: str) -> Deck:
        """Return the deck of ngspice's own transient: its flat cards, with the step at t = 0."""
        cards = [_CHARGE.sub("", line) for line in self._cards if line[0] not in "vi"]
        cards += [_stepping(part, transient) for part in self.flat.branches if self._steps(part)]
        cards += [
            f"X{c.name} {c.noninverting} {c.inverting} {c.output} {c.model}"
            for c in self.flat.opamps
        ]
        nodes = tuple(out.node for out in self.circuit.outputs)
        models = [model.text(name) for name, model in self.opamps.items()]
        amps = max(1e-12, transient.current)
        charge = transient.charge or 1e-18
        closing = [
            f".options {solver} reltol={RELATIVE!r} abstol={amps!r} vntol={1e-3 * RELATIVE!r}",
            f".options chgtol={charge!r} gmin=1e-15 pivtol=1e-18",
            f".options method=trap trtol={transient.truncation / RELATIVE!r}",
            ".save " + " ".join(f"v({node})" for node in nodes),
            f".tran {10.0 * transient.begin!r} {transient.stop!r} 0.0 {transient.max_step!r}"
            + (" uic" if self.initial == "zero" else ""),
            ".end",
            "",
        ]
        text = "\n".join(["* flat cards of a deck", *models, *cards, *closing])
        return Deck(text, nodes, transient)

    @property
    def flat_text(self) -> str:
        """The deck of ngspice's transient with its own steps, of 1/1000 of the record."""
        from taction.verification.engines.statespace.linearised.time_scales import time_scales

        stop = time_scales(self.circuit, initial=self.initial).stop or 1.0
        plan = Transient(stop, 1e-3 * stop, initial=self.initial)
        return self.witness(plan, "noopiter").text

    @property
    def _cards(self) -> Iterator[str]:
        for line in self.lines:
            if PINS not in line and RAILS not in line:
                yield line

    def _steps(self, part: Branch) -> bool:
        """Whether a part is a source of its own, not the constant of a B card."""
        return isinstance(part, Source) and self.flat.stimuli[part.card].kind != FIXED

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the ``.param`` cards that can be moved."""
        return self.deck.parameters

    def at(self, changes: Sequence[Mapping[str, float]]) -> list[Circuit | InputError]:
        """Return the circuit at some values of its ``.param`` cards, one ngspice run for all.

        Where a value gives no circuit, its error is in the place.

        Raises
        ------
        InputError
            ngspice does not expand the deck with one of them.
        """
        try:
            return [
                self._circuit(cards) for cards in expand(self._stubbed, find_simulator(), changes)
            ]
        except DidNotLoad as error:
            text = f"with other values of its .param: {one_line(error)}"
            raise InputError(self.deck.file, Complaint("deck", "", text)) from None

    def value_of(self, parameter: str) -> float | None:
        """Return the value of a ``.param``, as ngspice computes it; None if it is no number."""
        probe = f"{PROBE} {PROBE} 0 {{{parameter}}}"
        try:
            (cards,) = expand((*self._stubbed, probe), find_simulator())
            (found,) = (card for card in cards if card.startswith(PROBE))
            return number(found.split()[-1])
        except (DidNotLoad, ValueError):
            return None

    @cached_property
    def _stubbed(self) -> tuple[str, ...]:
        return tuple(with_stubs(self.deck, vendors_of(self.deck, self.linearise)))

    def _circuit(self, cards: Iterable[str]) -> Circuit | InputError:
        try:
            if self.linearise:
                cards, _ = _linearised(cards)
            flat, _ = stepped(read_cards(cards), small=self.linearise)
        except CardError as error:
            return InputError(self.deck.file, Complaint("deck", "", str(error)))
        try:
            flat = _with_models(self.deck, flat, self.supplied)
        except InputError as error:
            return error
        outputs = [out.node for out in self.circuit.outputs]
        return circuit_of(flat, self.circuit.name, outputs, self.circuit.models)


def read_board(
    file: str | Path,
    outputs: Sequence[str] = (),
    *,
    linearise: bool = False,
    wait: bool = False,
) -> ForeignBoard:
    """Read a deck as a board.

    Parameters
    ----------
    outputs : sequence of str
        Nodes of interest; by default those that the deck shows, else the usual names of outputs.
    linearise : bool
        Take diodes and transistors for linear at ngspice's operating point.
    wait : bool
        Whether ngspice, which expands the deck, waits for the deck of its transient.

    Raises
    ------
    InputError
        A card that is not accepted, with its line and what is; a node that is not there.
    SimulationError
        ngspice is missing, or does not expand the deck.
    """
    deck = with_first_steps(read_deck(file))
    deck = with_own_parameters(deck, vendors_of(deck, linearise))
    vendors = vendors_of(deck, linearise)
    stubbed, run = tuple(with_stubs(deck, vendors)), None
    try:
        if wait:
            cards, run = expand_and_wait(stubbed, find_simulator())
        else:
            (cards,) = expand(stubbed, find_simulator())
    except DidNotLoad as error:
        refused = unbraced_expression(deck) if "unknown parameter" in str(error) else None
        refused = refused or table(deck, str(error))
        said = Complaint("deck", "", one_line(error))
        raise refused or InputError(deck.file, said) from None
    try:
        small = ""
        if linearise:
            cards, small = _linearised(cards)
        flat, stimulus = stepped(read_cards(cards), small=bool(small))
    except CardError as error:
        accepted = "" if linearise else f"; {LINEAR}"
        raise InputError(deck.file, Complaint("deck", "", f"{error}{accepted}")) from None
    nodes = outputs_of(flat, outputs, (card.text for card in deck.left))
    if len(flat.nodes) > MOST_UNKNOWNS:
        text = f"the deck has {len(flat.nodes)} nodes; up to {MOST_UNKNOWNS} are read"
        raise InputError(deck.file, Complaint("deck", "", text))
    supplied = {kind: f"{MODEL.format(kind[0])}_{n}" for n, kind in enumerate(_kinds(deck, flat))}
    imported = {
        name: _imported(deck, vendors[k], order, low, high)
        for (k, order, low, high), name in supplied.items()
    }
    flat = _with_models(deck, flat, supplied)
    circuit = circuit_of(flat, deck.file.stem, nodes, _as_opamps(imported))
    immediate = any(re.search(r"\buic\b", c.text) for c in deck.left if c.word == ".tran")
    immediate &= not small  # the small signal begins where the circuit rests
    return ForeignBoard(
        deck,
        flat,
        circuit,
        "zero" if immediate else "rest",
        (*([small] if small else ()), stimulus, *_notes(deck, flat, vendors, imported, immediate)),
        imported,
        tuple(cards),
        linearise,
        supplied,
        run,
    )


def _linearised(cards: Iterable[str]) -> tuple[tuple[str, ...], str]:
    from taction.verification.studies.small_signal import linearised

    return linearised(cards, find_simulator())


def _as_opamps(imported: Mapping[str, ImportedOpAmp]) -> dict[str, OpAmp]:
    if not imported:
        return {}
    from taction.netlist_gen.board.opamp_choice import as_opamp

    return {name: as_opamp(name, model) for name, model in imported.items()}


def _notes(
    deck: ForeignDeck,
    flat: Flat,
    vendors: Sequence[str],
    imported: Mapping[str, ImportedOpAmp],
    immediate: bool,
) -> Iterator[str]:
    if immediate:
        yield "uic: the board starts with no charge"
    yield from deck.remarks
    yield from unanswered(deck)
    for name in dict.fromkeys(ltspice_opamps(deck).values()):
        yield (
            f"{name}: the linear part of LTspice's op-amp of this name, its gain, bandwidth and"
            " phase margin; its limits and its noise do not count"
        )
    for name in missing_cards(deck.lines)[1]:
        yield f"{name}(): a drawn value counts with its nominal one; --tolerances draws"
    for card in deck.left:
        celsius = _TEMPERATURE.search(card.text)
        if celsius and celsius[1] != "27":
            yield f"{card.text}: does not count; every part is at 27 degrees C"
        if card.word == ".step":
            yield f"{card.text}: does not run; {_sweep_of(card.text)} does it"
    for model_name, model in imported.items():
        cells = [c for c in flat.opamps if c.model == model_name]
        if model.linear is not None:
            name = vendors[_vendor(model_name)]
            inputs = f" with its inputs at {model.middle:g} V" if model.middle else ""
            yield (
                f"{', '.join('x' + c.name for c in cells)}: the macromodel {name} is replaced by"
                f" its linear model, measured at {model.supplies}{inputs}, within"
                f" {100 * model.linear.error:.2g} %; ngspice's transient keeps it, with its slew"
                " rate and its swing"
            )
    times = {found.at for found in flat.stimuli.values() if found.moves}
    if len(times) > 1:
        yield "the sources change at different times; all steps are taken at t = 0"
    if any(
        found.kind in ("pulse", "pwl", "exp") and found.moves for found in flat.stimuli.values()
    ):
        yield "edges are steps: rise times and later edges of the sources do not count"
    if any(found.kind == "sin" for found in flat.stimuli.values()):
        yield "a sine counts with its offset"
    if flat.absent:
        yield f"without capacitance, so left out: {', '.join(flat.absent)}"
    if flat.charged or any(card.word == ".ic" for card in deck.left):
        yield "initial charges (ic=, .ic) do not count"


def _sweep_of(text: str) -> str:
    """Return the option that sweeps as a card ``.step`` does."""
    words = [w for w in text.split()[1:] if w not in ("param", "lin", "dec", "oct", "temp")]
    name, values = words[:1], words[1:]
    if values[:1] == ["list"] and len(values) > 1:
        return f"--over {name[0]}={','.join(values[1:])}"
    return f"--over {name[0]}={':'.join(values[:2])}" if len(values) > 1 else "--over"


def _stepping(part: object, transient: Transient) -> str:
    """Return a source that steps at t = 0."""
    assert isinstance(part, Source)  # noqa: S101 - see `_steps`
    before, after = part.before, part.value
    if before == after or transient.initial == "zero":
        wave = f"dc {after!r}"
    else:
        wave = f"dc {before!r} PWL(0 {before!r} {EDGE * transient.begin!r} {after!r})"
    return f"{part.card} {part.a} {part.b} {wave}"


def _vendor(model: str) -> int:
    """Return the number of the subcircuit that a model of an op-amp replaces."""
    return int(model.removeprefix(MODEL.format("")).partition("_")[0])


def _kinds(deck: ForeignDeck, flat: Flat) -> dict[Supplied, list[OpAmpCell]]:
    """Return the op-amps of vendors by their subcircuit and their supply voltages."""
    held, found = _held(flat), dict[Supplied, list[OpAmpCell]]()
    for cell in flat.opamps:
        third, fourth = flat.rails[cell.name]
        order, out = 0, cell.output
        high, low = (held.get(node) for node in (third, fourth))
        if high is None and fourth in held and out in held:
            order, out = 1, third
            high, low = held[fourth], held[cell.output]
        if high is None or low is None:
            high, low = (_through(flat, held, node) for node in (third, fourth))
        if high is None or low is None:
            node = third if high is None else fourth
            text = (
                f"x{cell.name} needs a voltage source at its supplies, such as 'VP {node} 0 5';"
                f" its ports are read as + - V+ V- out: V+ at {third}, V- at {fourth}"
            )
            raise InputError(deck.file, Complaint("supply", repr(node), text))
        if not high > low:
            value, text = f"{high:g} V and {low:g} V", f"x{cell.name} needs V+ above V-"
            raise InputError(deck.file, Complaint("supply", value, text))
        kind = _vendor(cell.model), order, low, high
        found.setdefault(kind, []).append(replace(cell, output=out))
    return found


def _through(flat: Flat, held: Mapping[str, float], node: str) -> float | None:
    """Return the voltage that a node has by way of resistors and coils; None if of several."""
    joined = dict[str, set[str]]()
    ends = [(part.a, part.b) for part in flat.resistors]
    ends += [(part.a, part.b) for part in flat.branches if isinstance(part, Coil)]
    for a, b in ends:
        joined.setdefault(a, set()).add(b)
        joined.setdefault(b, set()).add(a)
    seen, left, found = {node}, [node], set[float]()
    while left:
        one = left.pop()
        if one in held:
            found.add(held[one])
        else:
            left += joined.get(one, set()) - seen
            seen |= joined.get(one, set())
    return found.pop() if len(found) == 1 else None


def _held(flat: Flat) -> dict[str, float]:
    """Return the voltages of the nodes that voltage sources hold, by way of one another, V."""
    sources = [part for part in flat.branches if isinstance(part, VoltageBetween)]
    held, known = {GROUND: 0.0}, -1
    while known < len(held):
        known = len(held)
        for part in sources:
            volts = flat.stimuli[part.card].after
            if part.b in held:
                held.setdefault(part.a, held[part.b] + volts)
            elif part.a in held:
                held[part.b] = held[part.a] - volts
    return held


def _with_models(deck: ForeignDeck, flat: Flat, names: Mapping[Supplied, str]) -> Flat:
    """Return flat cards in which each op-amp has the name of its model at its supplies."""
    cells = []
    for kind, members in _kinds(deck, flat).items():
        if kind not in names:
            text = "the models of the op-amps hold for the deck's own supplies only"
            value = f"{kind[-2]:g} V and {kind[-1]:g} V"
            raise InputError(deck.file, Complaint("supply", value, text))
        cells += [replace(cell, model=names[kind]) for cell in members]
    return replace(flat, opamps=cells)


def _imported(deck: ForeignDeck, name: str, order: int, low: float, high: float) -> ImportedOpAmp:
    """Import one macromodel of the deck, in an order of the pins or with inputs exchanged.

    The order + - V+ V- out is that of nearly all vendors; the sign of the measured gain tells
    whether the inputs are exchanged.
    """
    from taction.verification.characterise.vendor_model import import_opamp

    roles = ORDERS[order]
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "macromodel.lib")
        place.write_text("\n".join(cards_of_models(deck)) + "\n")
        try:
            try:
                found = import_opamp(str(place), name, roles, half, middle=middle)
            except InputError as error:
                if "exchange the roles" not in str(error):
                    raise
                turned = (roles[1], roles[0], *roles[2:])
                found = import_opamp(str(place), name, turned, half, middle=middle)
        except (InputError, SimulationError) as error:
            text = str(error).replace(str(place), deck.file.name)
            if isinstance(error, SimulationError):
                text = f"ngspice does not measure it on its test bench: {one_line(error)}"
            raise InputError(deck.file, Complaint(f".subckt {name}", "", text)) from None
    if found.linear is None:
        raise InputError(deck.file, Complaint(f".subckt {name}", "", found.missing))
    return found
