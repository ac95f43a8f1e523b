"""What a builder of a board gets, and what the board's verdict is."""

from __future__ import annotations

from dataclasses import dataclass, field

from taction.netlist_gen.board.bill_of_materials import BillOfMaterials
from taction.netlist_gen.scene.scene import Scene
from taction.system.output_files import check_own_folder
from taction.system.results import Result
from taction.verification.verdict.verify import Verdict

KICAD, REPORT = "kicad", "report.html"
OWN = {
    REPORT: "the verdict, with pictures",
    "parts.csv": "what to buy",
    "wiring.csv": "what is joined to what, pin by pin",
    "deck.cir": "the deck for ngspice",
}
"""What the files in the folder are; below `KICAD` is the KiCad project."""


def check_build_folder(folder: str) -> None:
    """Refuse a folder that holds other files at its top level.

    Raises
    ------
    InputError
        See `check_own_folder`; other files below `KICAD` are found when the board is known.
    """
    check_own_folder(folder, [*OWN, KICAD])


@dataclass(frozen=True, slots=True)
class BuiltBoard(Result):
    """The files for building a board, with its verdict.

    Attributes
    ----------
    files : tuple of str
        Names below the folder.
    parts : BillOfMaterials
        The parts to buy.
    verdict : Verdict or None
        None if the verification gave no verdict.
    refused : str
        Why there is no verdict.
    exit_status : int or None
        Of the command without a verdict; None: that of the verdict.
    """

    VIEW = "taction.verification.report.views.built_board:view"
    DOCUMENT = (
        *("scene = scene.name", "folder", "files # names below the folder", "outcome"),
        *("refused # why there is no verdict", "checks = verdict.checks"),
        *("opamp = parts.opamp", "packages = parts.packages", "unused_opamps = parts.spare"),
        *("not_standard # values that are in no series", "not_listed = parts.not_listed"),
    )

    scene: Scene = field(repr=False)
    folder: str
    files: tuple[str, ...] = field(repr=False)
    parts: BillOfMaterials = field(repr=False)
    verdict: Verdict | None = None
    refused: str = ""
    exit_status: int | None = None

    @property
    def outcome(self) -> str:
        """That of the verdict; inconclusive without one."""
        return "inconclusive" if self.verdict is None else str(self.verdict.outcome.value)

    @property
    def not_standard(self) -> int:
        """Number of values that no series has."""
        return sum(line.preferred is not None for line in self.parts.lines)
