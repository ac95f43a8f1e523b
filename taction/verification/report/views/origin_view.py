"""Where a result comes from, below every page: versions, machine and hashes; what is installed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from taction.netlist_gen.scene.keys import files_of
from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.blocks import Facts, Page, Section
from taction.verification.studies.running.installation import Installation
from taction.verification.studies.running.versions import describe_machine, digest, own_code

Rows = tuple[tuple[str, str], ...]
SHOWN = ("date", "taction", "python", "numpy", "scipy", "ngspice", "system", "processor", "cores")


def origin_section(scene: Scene | None, more: Rows = ()) -> Section:
    """Return the versions and hashes behind a page, after the rows `more`; None: many scenes."""
    return Section("Versions and hashes", lambda: Facts("", tuple(_rows(scene, more))))


def _rows(scene: Scene | None, more: Rows) -> Iterator[tuple[str, str]]:
    """Yield versions, machine, and the SHA-256 of every file that the scene was read from."""
    if scene is not None:
        yield "scene file", str(scene.file)
    yield from more
    machine = describe_machine()
    yield from ((name, "none" if machine[name] is None else str(machine[name])) for name in SHOWN)
    if scene is None:
        return
    yield "SHA-256 of taction's source", own_code().hex()
    for key, value in {"": str(scene.file), **files_of(scene)}.items():
        if isinstance(value, str | Path):
            file = scene.folder / value if key else Path(value)
            if file.is_file():  # it may be gone since the run
                yield f"SHA-256 of {value}", hashlib.sha256(file.read_bytes()).hexdigest()
        elif value is not None:
            yield f"SHA-256 of {key}, an array", digest(value).hex()


def installation_view(result: Installation) -> Page:
    """Return what is installed, and what each part is needed for."""
    lines = [
        line
        for each in result.findings
        for line in (
            f"{'ok     ' if each.ok else 'missing'}  {each.what}: {each.found}",
            f"         {each.means}",
        )
    ]
    missing = sum(not each.ok for each in result.findings)
    return Page(
        title="installation",
        command="taction self doctor",
        summary=f"missing: {missing}" if missing else "nothing is missing",
        sections=(Section("Parts", lines, media="terminal page notebook"),),
    )
