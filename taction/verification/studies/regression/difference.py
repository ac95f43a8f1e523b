"""The difference of two boards: keys of their scenes or their parts, then readings with bounds.

Both are bounds, so their sum bounds the error of a difference. A scene is compared with a deck by
the deck that it writes, read back, so that both are measured alike. A record is compared with the
state-space solution of the board at the record's instants.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.scene import Scene, read_toml
from taction.spice_models.branches import Source
from taction.system.array_types import Floats, Waveforms
from taction.system.documents import OPTIONAL
from taction.system.errors import Complaint, InputError
from taction.system.quantities import quantity
from taction.system.raw_file import read_transient
from taction.system.reading_definitions import READINGS, SETTLING_BAND
from taction.system.results import Result
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.readings.measurements import measure as measure_record
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.decks.foreign_board import ForeignBoard, read_board
from taction.verification.studies.decks.measured_board import Start, measure_board, step_response
from taction.verification.studies.decks.questions import record_of
from taction.verification.verdict.board_files import deck_of
from taction.verification.verdict.record import (
    Channel,
    Difference,
    Record,
    compare,
    relative,
    within_uncertainties,
)
from taction.verification.verdict.run import state_space_beside
from taction.verification.verdict.transient_plan import state_space_tolerance
from taction.verification.verdict.verify import Verdict

Value = bool | int | float | str
Curves = Callable[[], tuple[Floats, Floats] | None]
"""Returns instants (P,), s, and outputs (P, N), V; None where they cannot be drawn."""

DECKS = (".cir", ".ckt", ".cki", ".sp", ".spice", ".net", ".asc")
RECORDS = (".raw",)
ACCEPTED = (
    "a scene (.toml; `taction new` writes one), a deck (.cir) or the raw file of one transient"
    " (.raw)"
)
_compared = partial(
    compare,
    tolerance=within_uncertainties,
    figures=("growth_rate", "frequency", "step_amplitude"),
    channel_figures=("equilibrium", *READINGS),
)


@dataclass(frozen=True, slots=True)
class KeyDifference:
    """A key of the scenes that differs; None where a scene does not have the key."""

    key: str
    first: Value | None
    second: Value | None
    unit: str | None
    content: bool = False  # the same name of a file, with another content


@dataclass(frozen=True, slots=True)
class VerdictDifference(Result):
    """The differences of two boards."""

    VIEW = "taction.verification.report.views.comparison_view:difference_view"
    DOCUMENT = ("first", "second", "keys", "readings", "outputs", "notes", "exit_status")

    first: str
    second: str
    # What differs in their scenes, or in the parts of their decks; None beside a raw file.
    keys: tuple[KeyDifference, ...] | None
    readings: tuple[Difference, ...]  # every reading of either
    outputs: tuple[str, ...] = ()  # names of the channels of readings; empty: u_1, u_2, ...
    notes: tuple[str, ...] = ()
    # Instants (P,), s, and outputs (P, N), V, of each.
    curves: tuple[Curves | None, Curves | None] = (None, None)

    @property
    def exit_status(self) -> int:
        """1 if a reading differs beyond the uncertainties, else 3 if that is unknown, else 0."""
        found = {reading.beyond for reading in self.readings}
        return 1 if True in found else 3 if None in found else 0


@dataclass(frozen=True, slots=True)
class StoredKey:
    """A key of a scene or a value of a deck, base units; a file has the SHA-256 of its content."""

    value: Value | None
    unit: str | None = None
    sha256: Annotated[str | None, OPTIONAL] = None


def key_differences(
    first: Mapping[str, StoredKey], second: Mapping[str, StoredKey]
) -> Iterator[KeyDifference]:
    """Yield the keys whose values differ."""
    nothing = StoredKey(None)
    for key in {**first, **second}:
        one, two = first.get(key, nothing), second.get(key, nothing)
        same = one.value == two.value
        if not same or one.sha256 != two.sha256:
            yield KeyDifference(key, one.value, two.value, one.unit or two.unit, content=same)


Keys = Mapping[str, StoredKey]


def compare_verdicts(
    first: Verdict, second: Verdict, keys: tuple[Keys, Keys], names: tuple[str, str]
) -> VerdictDifference:
    """Return the differences of two verdicts; `keys` are those of their scenes."""
    readings, differ = _compared(Record.of(first), Record.of(second)), tuple(key_differences(*keys))
    curves = (lambda: (first.waveforms.time, first.u)), (lambda: (second.waveforms.time, second.u))
    return VerdictDifference(*names, differ, readings, curves=curves)


def is_circuit(given: object) -> bool:
    """Return whether something is a file of a deck, or of a record of waveforms, by its ending."""
    return ends_with(given, (*DECKS, *RECORDS))


def ends_with(given: object, endings: tuple[str, ...]) -> bool:
    """Return whether something is a file with one of these endings."""
    return isinstance(given, str | Path) and Path(given).suffix.lower() in endings


def refuse_pair(first: object, second: object) -> None:
    """Refuse two things that cannot be compared, or a file that is none of them."""
    for given in (first, second):
        if ends_with(given, (".json",)):
            text = "a document; expected its scene. `taction regress` compares with stored results"
            raise InputError(str(given), Complaint("file", "", text))
    if ends_with(first, RECORDS) and ends_with(second, RECORDS):
        text = "a second record; expected the scene or the deck of the board (.toml, .cir)"
        raise InputError(str(second), Complaint("file", "", text))
    for given in (first, second):
        if isinstance(given, str | Path):
            path = Path(given)
            if not path.is_file() and path.suffix.lower() != ".asc":
                text = f"No such file or directory; expected {ACCEPTED}"
                raise InputError(path, Complaint("file", "", text))
            if not ends_with(given, (*DECKS, *RECORDS)):
                read_toml(path, ACCEPTED)


UNITS_OF_SOURCES = {"V": "V", "I": "A"}
Place = str | Path | Scene


def compare_circuits(
    first: Place | Verdict, second: Place | Verdict, agree: float
) -> VerdictDifference:
    """Compare two boards, at least one of which is a deck or a record; see `refuse_pair`.

    `agree` is the accepted error of a record, as a share of the largest step.
    """
    (one, name), (other, named) = _named(first), _named(second)
    if ends_with(one, RECORDS):
        return _with_record(one, other, (name, named), agree, last=False)
    if ends_with(other, RECORDS):
        return _with_record(other, one, (name, named), agree, last=True)
    return _decks((one, other), (name, named))


def _named(given: Place | Verdict) -> tuple[Place, str]:
    """Return a scene or a file that is none, and what it is called."""
    if isinstance(given, Verdict):
        given = given.scene
    name = given.name if isinstance(given, Scene) else str(given)
    return given if is_circuit(given) else read_scene(given), name


def _decks(places: tuple[Place, Place], names: tuple[str, str]) -> VerdictDifference:
    """Compare two linear boards, of which a scene stands for the deck that it writes."""
    boards = [_board(each) for each in places]
    scenes = [isinstance(each, Scene) for each in places]
    shared = [out.node for out in boards[scenes[1]].circuit.outputs]
    if not any(scenes):
        others = boards[1].flat.nodes
        shared = [node for node in shared if node in others] or shared
    sides = [
        measure_board(LinearBoard(each.circuit), each.initial, SETTLING_BAND)
        for each in (_with_outputs(board, shared) for board in boards)
    ]
    readings = _compared(*map(record_of, sides), groups=("states", "figures", "channels"))
    keys = tuple(key_differences(_parts(boards[0]), _parts(boards[1])))
    notes = tuple(dict.fromkeys(note for each in boards for note in each.notes))
    curves = sides[0].curve, sides[1].curve
    return VerdictDifference(*names, keys, readings, tuple(shared), notes, curves)


def _with_record(
    record: Place, board: Place, names: tuple[str, str], agree: float, *, last: bool
) -> VerdictDifference:
    """Compare a record, the `last` of both, with the state-space solution of a board."""
    assert not isinstance(record, Scene)  # noqa: S101 - it has the ending of a file
    wave = read_transient(record)
    circuit, start, delay, notes = _stepped(board, wave)
    known = tuple(out for out in circuit.outputs if out.node in wave.nodes)
    if not known:
        nodes = ", ".join(out.node for out in circuit.outputs)
        text = f"it has no output of {names[not last]}; expected one of {nodes}"
        raise InputError(record, Complaint("nodes", ", ".join(wave.nodes[:20]), text))
    kept = wave.time >= delay  # it begins at the step
    if int(kept.sum()) < 2:
        text = f"the record ends at {wave.time[-1]:.6g} s; the step is at {delay:.6g} s"
        raise InputError(record, Complaint("raw file", "", text))
    wave = replace(wave, time=wave.time[kept] - delay, values=wave.values[kept])
    linear, stop = LinearBoard(replace(circuit, outputs=known)), float(wave.time[-1])
    transient = Transient(stop, 1e-3 * stop, initial=start)
    beside = state_space_beside(linear, transient, wave, state_space_tolerance(agree))
    response, time = step_response(linear, start, SETTLING_BAND), beside.instants
    allowed = agree * response.step.amplitude + beside.doubt
    sides = [(beside.other, beside.doubt), (beside.u, allowed)][:: 1 if last else -1]
    records = []
    for u, error in sides:  # the bound of a waveform's error, V
        found = measure_record(time, u, response.target, response.start, error=error).channels
        channels = map(Channel.of, found)
        bounded = (replace(c, uncertainties=c.uncertainties | {"final": error}) for c in channels)
        records.append(Record("", "", channels=tuple(bounded)))
    channel_figures = ("final", *READINGS)
    readings = _compared(*records, groups=("states", "channels"), channel_figures=channel_figures)
    (one, _), (two, _) = sides
    shared = tuple(out.node for out in known)
    apart = []
    for node, a, b in zip(shared, one.T, two.T, strict=True):
        k = int(np.abs(b - a).argmax())
        values, note = (float(a[k]), float(b[k])), f"at {quantity(float(time[k]), 's')}"
        off = relative(abs(values[1] - values[0]), allowed)
        far = values[1] - values[0]
        apart.append(Difference("waveforms", node, None, *values, "V", far, allowed, off, note))
    curves = (lambda: (time, one)), (lambda: (time, two))
    return VerdictDifference(*names, None, (*apart, *readings), shared, notes, curves)


def _board(given: Place) -> ForeignBoard:
    """Read a deck, or the deck that a scene writes."""
    if not isinstance(given, Scene):
        return read_board(given)
    deck = deck_of(given)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "board.cir")
        file.write_text(deck.text, encoding="utf-8")
        board = read_board(file)
    if not board.is_linear:
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


def _parts(board: ForeignBoard) -> dict[str, StoredKey]:
    """Return values and nodes of the parts, by the names of their cards."""
    circuit, flat, found = board.circuit, board.flat, dict[str, StoredKey]()
    for knob in circuit.knobs:
        found[knob.name] = StoredKey(circuit.value(knob.name), circuit.facts[knob.name].unit)
    for source in board.point.flat.sources:
        name, unit = source.label, UNITS_OF_SOURCES[source.letter]
        found[name] = StoredKey(source.value, unit)
        found[f"{name} before the step"] = StoredKey(source.before, unit)
    for part in flat.parts:
        name = part.label
        if part.letter in UNITS_OF_SOURCES and not isinstance(part, Source):  # of an expression
            found[name] = StoredKey(part.value, UNITS_OF_SOURCES[part.letter])
        found[f"{name} nodes"] = StoredKey(" ".join(part.nodes))
    return found


def _stepped(board: Place, wave: Waveforms) -> tuple[Circuit, Start, float, tuple[str, ...]]:
    """Return the circuit, how it starts, when it is stepped, s, and what to say of it."""
    if isinstance(board, Scene):
        deck = deck_of(board)
        assert isinstance(deck.analysis, Transient)  # noqa: S101 - `deck_of` writes transients
        return deck.circuit, deck.analysis.initial, 0.0, ()
    found = read_board(board)
    if not found.is_linear:
        text = "is not linear, and small signals say nothing of a record; expected a linear deck"
        raise InputError(board, Complaint("deck", "", text))
    steps = [source.at for source in found.point.flat.sources if source.step]
    if not any(out.node in wave.nodes for out in found.circuit.outputs):
        shared = [node for node in wave.nodes if node in found.flat.nodes]
        found = _with_outputs(found, shared) if shared else found
    return found.circuit, found.initial, min(steps, default=0.0), found.notes
