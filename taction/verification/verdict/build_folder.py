"""The folder of a built board; one with other files is refused before numpy is loaded."""

from __future__ import annotations

from taction.system.output_files import check_own_folder

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
