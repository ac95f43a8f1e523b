"""What two things that are compared are, by their endings; what cannot be compared is refused.

Nothing here loads an engine, so a wrong pair is refused at once.
"""

from __future__ import annotations

from pathlib import Path

from taction.netlist_gen.scene.loading import read_toml
from taction.system.errors import Complaint, InputError

DECKS = (".cir", ".ckt", ".cki", ".sp", ".spice", ".net", ".asc")
RECORDS = (".raw",)
ACCEPTED = (
    "a scene (.toml; `taction new` writes one), a deck (.cir), the raw file of one transient (.raw)"
    " or a stored verdict (.json)"
)


def is_circuit(given: object) -> bool:
    """Return whether something is a file of a deck, or of a record of waveforms, by its ending."""
    return ends_with(given, (*DECKS, *RECORDS))


def ends_with(given: object, endings: tuple[str, ...]) -> bool:
    """Return whether something is a file with one of these endings."""
    return isinstance(given, str | Path) and Path(given).suffix.lower() in endings


def refuse_pair(first: object, second: object) -> None:
    """Refuse two things that cannot be compared.

    Raises
    ------
    InputError
        Two records, a stored verdict beside a deck or a record, or a file that is none of them.
    """
    for given, other in ((first, second), (second, first)):
        if ends_with(given, (".json",)) and is_circuit(other):
            text = f"a stored verdict has no circuit to compare with {other}; expected its scene"
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
            if not ends_with(given, (*DECKS, *RECORDS, ".json")):
                read_toml(path, ACCEPTED)
