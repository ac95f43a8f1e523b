"""Where a result comes from: versions, machine and hashes, below every page."""

from __future__ import annotations

from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.blocks import Facts, Section
from taction.verification.report.html.sections.origin import machine_rows, origin_rows

Rows = tuple[tuple[str, str], ...]


def origin_section(scene: Scene, more: Rows = ()) -> Section:
    """Return the versions and hashes behind a page, after the rows `more`."""
    return Section(
        "Versions and hashes",
        lambda: (Facts("", (("scene file", str(scene.file)), *more, *origin_rows(scene))),),
    )


def plain_origin(more: Rows = ()) -> Section:
    """Return the versions behind a page on many scenes."""
    return Section("Versions and hashes", lambda: (Facts("", (*more, *machine_rows())),))
