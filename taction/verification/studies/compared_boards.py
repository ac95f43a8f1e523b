"""Two boards beside each other that are no two scenes: a deck, or the record of a raw file.

A scene is compared with a deck by the deck that it writes, read back, so that both are measured
alike: against their own equilibrium. A record is compared with the state-space solution of the
board at the record's own instants, and both are measured by the same functions.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.netlist_gen.deck.flat_cards import shown
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.foreign_raw import read_transient
from taction.system.quantities import quantity
from taction.system.reading_definitions import READINGS, SETTLING_BAND
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.readings.measurements import Measurements
from taction.verification.readings.measurements import measure as measure_record
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.compared_files import RECORDS, ends_with, is_circuit
from taction.verification.studies.difference import (
    CHANNEL_FIGURES,
    FIGURES,
    Curves,
    StoredKey,
    VerdictDifference,
    key_differences,
)
from taction.verification.studies.foreign_board import ForeignBoard, read_board
from taction.verification.studies.measured_board import (
    MeasuredBoard,
    Start,
    measure_board,
    step_response,
)
from taction.verification.verdict.companion import Companion, state_space_companion
from taction.verification.verdict.compare import Difference, compare, relative, within_uncertainties
from taction.verification.verdict.deck import deck_of
from taction.verification.verdict.record import Channel, Record
from taction.verification.verdict.transient_plan import state_space_tolerance
from taction.verification.verdict.verify import Verdict

GROUPS = ("states", "figures", "channels")
UNITS_OF_SOURCES = {"V": "V", "I": "A"}
Place = str | Path | Scene
Given = Place | Verdict


def compare_circuits(first: Given, second: Given, agree: float) -> VerdictDifference:
    """Compare two boards, at least one of which is a deck or the record of a raw file.

    Parameters
    ----------
    first, second : path, Scene or Verdict
        A scene or a verdict stands for its board; `refuse_pair` accepts them.
    agree : float
        Accepted error of a record, as a share of the largest step.

    Raises
    ------
    InputError
        A file cannot be read, or the two have no output in common.
    SimulationError
        ngspice is missing, which expands the decks.
    EngineError
        A board has no equilibrium, or no exact solution for the whole record.
    """
    places = [_place(first), _place(second)]
    names = (_name(first), _name(second))
    recorded = [ends_with(each, RECORDS) for each in places]
    if not any(recorded):
        return compare_decks(places[0], places[1], names)
    record, board = places if recorded[0] else reversed(places)
    assert not isinstance(record, Scene)  # noqa: S101 - it has the ending of a file
    return compare_with_record(record, board, names, agree, last=recorded[1])


def _place(given: Given) -> Place:
    if isinstance(given, Verdict):
        return given.scene
    return given if isinstance(given, str | Path) and is_circuit(given) else read_scene(given)


def _name(given: Given) -> str:
    return (
        str(given)
        if isinstance(given, str | Path)
        else (given.scene.name if isinstance(given, Verdict) else given.name)
    )


def compare_decks(first: Place, second: Place, names: tuple[str, str]) -> VerdictDifference:
    """Compare two linear boards, at least one of which is a deck.

    Parameters
    ----------
    first, second : path or Scene
        A scene stands for the deck that it writes.
    names : (str, str)
        How both are called.

    Raises
    ------
    InputError
        A deck cannot be read, or the two have no output in common.
    SimulationError
        ngspice is missing, which expands the decks.
    EngineError
        A board has no equilibrium, or no state-space form.
    """
    boards = [_board(each) for each in (first, second)]
    wanted = boards[0] if not isinstance(second, Scene) else boards[1]
    shared = [out.node for out in wanted.circuit.outputs]
    if not isinstance(first, Scene) and not isinstance(second, Scene):
        others = boards[1].flat.nodes
        shared = [node for node in shared if node in others] or shared
    sides = [_measured(_with_outputs(each, shared)) for each in boards]
    return VerdictDifference(
        *names,
        tuple(key_differences(_parts(boards[0]), _parts(boards[1]))),
        compare(
            sides[0].record(),
            sides[1].record(),
            within_uncertainties(),
            groups=GROUPS,
            figures=FIGURES,
            channel_figures=CHANNEL_FIGURES,
        ),
        tuple(shared),
        tuple(dict.fromkeys(note for each in boards for note in each.notes)),
        (sides[0].curve, sides[1].curve),
    )


def compare_with_record(
    record: str | Path, board: Place, names: tuple[str, str], agree: float, *, last: bool
) -> VerdictDifference:
    """Compare a stored record with the state-space solution of a board.

    Parameters
    ----------
    record : path
        A raw file; a node of every output of the board that it has is compared.
    board : path or Scene
        A scene, or a deck.
    names : (str, str)
        How the first and the second are called.
    agree : float
        Accepted difference of a waveform, as a share of the largest step.
    last : bool
        Whether the record is the second of the two.

    Raises
    ------
    InputError
        A file cannot be read, or the record has no output of the board.
    EngineError
        The state-space engine has no solution for the whole record, or none with a known error.
    """
    wave = read_transient(record)
    circuit, start, delay, notes = _expected(board, wave)
    known = tuple(out for out in circuit.outputs if out.node in wave.nodes)
    if not known:
        nodes = ", ".join(out.node for out in circuit.outputs)
        text = f"it has no output of {names[not last]}; expected one of {nodes}"
        raise InputError(record, Complaint("nodes", ", ".join(wave.nodes[:20]), text))
    wave = _from(wave, delay, record)
    linear = LinearBoard(replace(circuit, outputs=known))
    stop = float(wave.time[-1])
    transient = Transient(stop, 1e-3 * stop, initial=start)
    tolerance = state_space_tolerance(agree)
    beside = state_space_companion(linear, transient, wave, tolerance)
    response, _ = step_response(linear, start, SETTLING_BAND)
    volts = agree * response.step.amplitude
    measured = [
        measure_record(beside.instants, u, response.target, response.start, error=error)
        for u, error in ((beside.other, beside.doubt), (beside.u, volts + beside.doubt))
    ]
    errors = beside.doubt, volts + beside.doubt
    records = [_of_record(m, error) for m, error in zip(measured, errors, strict=True)]
    curves = [_curves(beside.instants, u) for u in (beside.other, beside.u)]
    if not last:
        records.reverse()
        curves.reverse()
    shared = tuple(out.node for out in known)
    readings = compare(
        records[0],
        records[1],
        within_uncertainties(),
        groups=("states", "channels"),
        channel_figures=("final", *READINGS),
    )
    apart = _apart(beside, shared, volts + beside.doubt, last=last)
    return VerdictDifference(
        *names, None, (*apart, *readings), shared, notes, (curves[0], curves[1]), has_record=True
    )


def _board(given: Place) -> ForeignBoard:
    """Read a deck, or the deck that a scene writes."""
    if not isinstance(given, Scene):
        return read_board(given)
    _, deck = deck_of(given)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "board.cir")
        file.write_text(deck.text, encoding="utf-8")
        board = read_board(file)
    if board.point is not None:
        text = "its deck is not linear; compare the scene with a raw file of the other deck"
        raise InputError(given.file, Complaint("deck", "", text))
    return board


def _with_outputs(board: ForeignBoard, nodes: Sequence[str]) -> ForeignBoard:
    if [out.node for out in board.circuit.outputs] == list(nodes):
        return board
    known, outputs = board.flat.nodes, board.circuit.outputs
    if missing := [node for node in nodes if node not in known]:
        listed = ", ".join(list(known)[:20])
        text = f"the deck has no node of this name, which the other shows; it has {listed}"
        raise InputError(board.deck.file, Complaint("node", repr(missing[0]), text))
    made = tuple(replace(outputs[0], node=node) for node in nodes)
    return replace(board, circuit=replace(board.circuit, outputs=made))


def _measured(board: ForeignBoard) -> MeasuredBoard:
    return measure_board(LinearBoard(board.circuit), board.initial, SETTLING_BAND)


def _curves(time: Floats, u: Floats) -> Curves:
    return lambda: (time, u)


def _parts(board: ForeignBoard) -> dict[str, StoredKey]:
    """Return values and nodes of the parts, by the names of their cards."""
    circuit, found = board.circuit, dict[str, StoredKey]()
    for knob in circuit.knobs:
        found[knob.name] = StoredKey(circuit.value(knob.name), circuit.facts[knob.name].unit)
    for card, source in board.flat.stimuli.items():
        found[shown(card.lower())] = StoredKey(source.after, UNITS_OF_SOURCES[card[0]])
        found[f"{shown(card.lower())} before the step"] = StoredKey(
            source.before, UNITS_OF_SOURCES[card[0]]
        )
    for name, nodes in _nodes(board):
        found[f"{name} nodes"] = StoredKey(" ".join(nodes))
    return found


def _nodes(board: ForeignBoard) -> Iterator[tuple[str, tuple[str, ...]]]:
    flat = board.flat
    plain: list[Resistor | Capacitor] = [*flat.resistors, *flat.capacitors]
    for part in plain:
        yield shown(part.card.lower()), (part.a, part.b)
    for branch in flat.branches:
        yield shown(branch.card.lower()), branch.nodes


def _expected(board: Place, wave: Waveforms) -> tuple[Circuit, Start, float, tuple[str, ...]]:
    """Return the circuit, how it starts, when it is stepped, s, and what to say of it."""
    if isinstance(board, Scene):
        circuit, deck = deck_of(board)
        assert isinstance(deck.analysis, Transient)  # noqa: S101 - `deck_of` writes transients
        return circuit, deck.analysis.initial, 0.0, ()
    found = read_board(board)
    if found.point is not None:
        text = "is not linear, and small signals say nothing of a record; expected a linear deck"
        raise InputError(board, Complaint("deck", "", text))
    steps = [each.at for each in found.flat.stimuli.values() if each.moves]
    if not any(out.node in wave.nodes for out in found.circuit.outputs):
        shared = [node for node in wave.nodes if node in found.flat.nodes]
        found = _with_outputs(found, shared) if shared else found
    return found.circuit, found.initial, min(steps, default=0.0), found.notes


def _from(wave: Waveforms, delay: float, file: str | Path) -> Waveforms:
    """Return a record that begins at the step."""
    kept = wave.time >= delay
    if int(kept.sum()) < 2:
        text = f"the record ends at {wave.time[-1]:.6g} s; the step is at {delay:.6g} s"
        raise InputError(file, Complaint("raw file", "", text))
    return replace(wave, time=wave.time[kept] - delay, values=wave.values[kept])


def _of_record(measured: Measurements, error: float) -> Record:
    """Return the record of measurements; the bound of a waveform's error is `error`, V."""
    channels = [Channel.of(each) for each in measured.channels]
    return Record(
        "",
        "",
        channels=tuple(
            replace(each, uncertainties=each.uncertainties | {"final": error}) for each in channels
        ),
    )


def _apart(
    beside: Companion, nodes: Sequence[str], allowed: float, *, last: bool
) -> Iterator[Difference]:
    """Yield the largest difference of each waveform, at its instant."""
    for n, node in enumerate(nodes):
        pair = beside.other[:, n], beside.u[:, n]
        one, two = pair if last else pair[::-1]
        place = int(np.abs(two - one).argmax())
        a, b = float(one[place]), float(two[place])
        note = f"at {quantity(float(beside.instants[place]), 's')}"
        off = relative(abs(b - a), allowed)
        yield Difference("waveforms", node, None, a, b, "V", b - a, allowed, off, note)
