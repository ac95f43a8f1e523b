"""What a builder of a board gets: its deck, its parts with their power at rest, and its files."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from taction.netlist_gen.board.bill_of_materials import BillOfMaterials, bill_of_materials
from taction.netlist_gen.board.circuit import Circuit, joined_resistors
from taction.netlist_gen.board.part_warnings import part_warnings
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.deck.dialects import DIALECTS, NATIVE, Measures
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import taken
from taction.system.errors import InputError, SolverError
from taction.system.results import Result
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.verdict.simulation import build
from taction.verification.verdict.verify import Verdict

EVEN_POINTS = 125.0  # on a period of ringing: an error of about 1e-4 of the step in ngspice


@dataclass(frozen=True, slots=True)
class Netlist(Deck):
    """The deck of a scene, with its board."""

    DOCUMENT = (
        *("files = written", "deck = printed", "omissions = circuit.omissions", "warnings"),
        "lambda = circuit.facts.lambda.value",
    )

    circuit: Circuit = field(kw_only=True, repr=False)  # `omissions`: what the scene does not need
    # Values that cannot be bought, or that the layout undoes.
    warnings: tuple[str, ...] = field(default=(), repr=False)
    written: tuple[str, ...] = field(default=(), repr=False)  # the file, if any

    @property
    def printed(self) -> str | None:
        """The text; None where it is in a file."""
        return None if self.written else self.text


def deck_of(scene: Scene, *, dialect: str = NATIVE, measures: bool = False) -> Netlist:
    """Return the deck that `verify` would run, and its board with a number for lambda.

    With `measures`, or in another `dialect`, the transient has even steps: step control is tuned
    for ngspice alone, and a measure is exact only to the spacing of the points. The errors are
    those of `taction.netlist`.
    """
    if (measures or dialect != NATIVE) and scene.analysis.points_per_period is None:
        even = {"points_per_period": EVEN_POINTS, "error": "auto"}
        scene = scene.model_copy(update={"analysis": scene.analysis.model_copy(update=even)})
    board = build(scene.with_engine("ngspice"))
    circuit, compared = board.circuit, None
    if complaints := list(DIALECTS[dialect].refusals(circuit)):
        raise InputError(scene.file, *complaints)
    if measures:  # they compare with the reference solution, at the output nodes
        if board.ideal.problem:
            raise SolverError(f"--measure needs a reference solution: {board.ideal.problem}")
        signs, ends = [out.sign for out in circuit.outputs], (board.ideal.target, board.ideal.start)
        targets, starts = (tuple((np.array(signs) * u).tolist()) for u in ends)
        compared = Measures(targets, starts, scene.checks.settling_time.band)
    deck = write_deck(circuit, board.transient, dialect=dialect, measures=compared)
    return taken(Netlist, deck, circuit=circuit, warnings=tuple(part_warnings(circuit)))


@dataclass(frozen=True, slots=True)
class BoardPower:
    """What a board takes at rest; ideal antilog stages take part in neither."""

    DOCUMENT = ("supply_current [A]", "total [W]")

    supply_current: float  # of the supply that carries more: quiescent and load currents, A
    total: float  # dissipation in op-amps and resistors, W


@dataclass(frozen=True, slots=True)
class PartsList(Result):
    """The parts of a board to buy, and its power at rest."""

    VIEW = "taction.verification.report.views.opamp_view:parts_view"
    DOCUMENT = (
        *("scene = scene.name", "parts = parts.lines", "opamps.preset = parts.opamp"),
        *("opamps.packages = parts.packages", "opamps.spare = parts.spare", "power"),
        "not_listed = parts.not_listed",
    )

    scene: Scene = field(repr=False)
    parts: BillOfMaterials = field(repr=False)
    power: BoardPower


def parts_list(scene: Scene) -> PartsList:
    """Return the parts and the power of the board of `scene`; `EngineError` without a rest."""
    circuit = synthesise(scene)
    power = board_power(LinearBoard(circuit))
    return PartsList(scene, bill_of_materials(circuit, scene), power)


def board_power(board: LinearBoard) -> BoardPower:
    """Return the power at the equilibrium of `board`; `EngineError` without one.

    An op-amp that drives the current I out of its output at the voltage V dissipates
    ``(supply - V) I``, of a current into the output ``(supply + V) |I|``.
    """
    circuit, rest = board.circuit, board.equilibrium
    joined = list(joined_resistors(circuit))
    nodes = sorted({node for a, b, _ in joined for node in (a, b)})
    volts, number = np.array([rest[node] for node in nodes]), {n: k for k, n in enumerate(nodes)}
    a, b = np.array([(number[one], number[other]) for one, other, _ in joined]).T
    across = volts[a] - volts[b]
    current = across / np.array([value for *_, value in joined])
    leaving = np.zeros(len(nodes))
    np.add.at(leaving, a, current)
    np.add.at(leaving, b, -current)
    loaded = [number[cell.output] for cell in circuit.opamps if cell.output in number]
    load, height = leaving[loaded], volts[loaded]
    quiet = sum(circuit.models[cell.model].supply_current for cell in circuit.opamps)
    sourced, sunk = np.maximum(load, 0.0), np.maximum(-load, 0.0)
    stages = (circuit.supply - height) @ sourced + (circuit.supply + height) @ sunk
    total = 2.0 * circuit.supply * quiet + float(stages + across @ current)
    return BoardPower(quiet + float(max(sourced.sum(), sunk.sum())), total)


KICAD, REPORT = "kicad", "report.html"
OWN = {
    REPORT: "the verdict, with pictures",
    "parts.csv": "what to buy",
    "wiring.csv": "what is joined to what, pin by pin",
    "deck.cir": "the deck for ngspice",
}
"""What the files in the folder are; below `KICAD` is the KiCad project."""


@dataclass(frozen=True, slots=True)
class BuiltBoard(Result):
    """The files for building a board, with its verdict."""

    VIEW = "taction.verification.report.views.verdict_view:built_view"
    DOCUMENT = (
        *("scene = scene.name", "folder", "files # names below the folder", "outcome"),
        *("refused # why there is no verdict", "checks = verdict.checks"),
        *("opamp = parts.opamp", "packages = parts.packages", "unused_opamps = parts.spare"),
        *("not_standard # values that are in no series", "not_listed = parts.not_listed"),
    )

    scene: Scene = field(repr=False)
    folder: str
    files: tuple[str, ...] = field(repr=False)  # names below the folder
    parts: BillOfMaterials = field(repr=False)  # to buy
    verdict: Verdict | None = None  # None if the verification gave no verdict
    refused: str = ""  # why there is no verdict
    exit_status: int | None = None  # of the command without a verdict; None: that of the verdict

    @property
    def outcome(self) -> str:
        """That of the verdict; inconclusive without one."""
        return "inconclusive" if self.verdict is None else str(self.verdict.outcome.value)

    @property
    def not_standard(self) -> int:
        """Number of values that no series has."""
        return sum(line.preferred is not None for line in self.parts.lines)
