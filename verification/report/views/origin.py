"""Where a result comes from: versions, machine and hashes, below every page."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.blocks import Facts, Section
from taction.verification.studies.running.digests import digest, files_of, own_code
from taction.verification.studies.running.versions import describe_machine

Rows = tuple[tuple[str, str], ...]
SHOWN = ("date", "taction", "python", "numpy", "scipy", "ngspice", "system", "processor", "cores")


def _machine_rows() -> Rows:
    """Return the versions and the machine."""
    machine = describe_machine()
    return tuple((name, "none" if machine[name] is None else str(machine[name])) for name in SHOWN)


def _origin_rows(scene: Scene) -> Rows:
    """Return versions, machine, and the SHA-256 of every file that the scene was read from."""
    rows = [*_machine_rows()]
    rows.append(("SHA-256 of taction's source", own_code().hex()))
    rows += [(f"SHA-256 of {name}", text) for name, text in _hashes(scene)]
    return tuple(rows)


def _hashes(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield the hashes of the files of a scene that still exist, and of its arrays in memory."""
    yield from _file_hash(str(scene.file), Path(scene.file))
    for key, value in files_of(scene).items():
        if isinstance(value, str | Path):
            yield from _file_hash(str(value), scene.folder / value)
        elif value is not None:
            yield f"{key}, an array", digest(value).hex()


def _file_hash(name: str, file: Path) -> Iterator[tuple[str, str]]:
    if file.is_file():
        yield name, hashlib.sha256(file.read_bytes()).hexdigest()


def origin_section(scene: Scene, more: Rows = ()) -> Section:
    """Return the versions and hashes behind a page, after the rows `more`."""
    return Section(
        "Versions and hashes",
        lambda: (Facts("", (("scene file", str(scene.file)), *more, *_origin_rows(scene))),),
    )


def plain_origin(more: Rows = ()) -> Section:
    """Return the versions behind a page on many scenes."""
    return Section("Versions and hashes", lambda: (Facts("", (*more, *_machine_rows())),))
