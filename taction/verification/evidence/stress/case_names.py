"""Names of stress cases and of their families; a wrong one is found before numpy is loaded."""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from pathlib import Path

from taction.system.errors import Complaint, InputError

FOLDER = Path(__file__).parents[3] / "scenes" / "stress"


def refuse_unknown(name: str, known: Collection[str] = ()) -> None:
    """Refuse a name that is neither a case nor a family.

    Parameters
    ----------
    known : collection of str
        Names of both; by default those of the files in `FOLDER`.

    Raises
    ------
    InputError
        The message has the nearest name.
    """
    known = known or _stored()
    if name not in known:
        import difflib

        close = difflib.get_close_matches(name, sorted(known), n=1, cutoff=0.0)
        text = f"no such case or family; did you mean {close[0]!r}?"
        raise InputError("--only", Complaint("NAME", repr(name), text))


def _stored() -> set[str]:
    files = sorted(FOLDER.glob("*.toml"))
    families = {path.stem for path in files}
    return families.union(*(tomllib.loads(path.read_text("utf-8"))["case"] for path in files))
