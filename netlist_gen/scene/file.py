"""Read a scene file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from netlist_gen.scene.scene import Scene, parse_scene
from spice_models.errors import Complaint, InputError

MAX_BYTES = 1_000_000


def load_scene(path: str | Path) -> Scene:
    """Read and validate the scene at `path`.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, or is not a scene; `complaints` lists all mistakes.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> scene.design.capacitance, scene.problem.channels
    (1e-11, 7)
    """
    path = Path(path)
    return parse_scene(_read_toml(path), path)


def _read_toml(path: Path) -> dict[str, Any]:
    accepted = "a scene file in TOML; `taction new` writes one"
    try:
        if path.exists() and not path.is_file():
            text = f"not a regular file; expected {accepted}"
            raise InputError(path, Complaint("file", "", text))
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, Complaint("file", "", f"over {MAX_BYTES} bytes; {accepted}"))
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(path, Complaint("file", "", f"{reason}; expected {accepted}")) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, Complaint("TOML", "", f"{error}; expected {accepted}")) from None
    except RecursionError:
        text = f"nested too deeply; expected {accepted}"
        raise InputError(path, Complaint("TOML", "", text)) from None
