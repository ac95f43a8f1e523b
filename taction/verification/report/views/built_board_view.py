"""The files for building a board, and the board's verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from taction.verification.report.blocks import BOTH, NOTEBOOK, Facts, Notes, Page, Section
from taction.verification.report.views.opamp_view import counts_text, packages_text
from taction.verification.report.views.verdict_screen_view import on_screen
from taction.verification.report.views.verdict_view import view as verdict_view
from taction.verification.verdict.board_power import KICAD, OWN, REPORT, BuiltBoard


def view(found: BuiltBoard) -> Page:
    """Return the verdict of a board, with what is in the folder and what a builder should know."""
    sections = (
        Section("Files", (Facts("Files", tuple(_files(found))),), media=BOTH),
        Section("Parts", (Notes("Parts", tuple(_notes(found))),), media=BOTH),
    )
    if found.verdict is None:
        text = f"no verdict: {found.refused}"
        return Page(found.scene.name, "taction build", found.outcome, text, (), sections)
    page = verdict_view(found.verdict, "taction build")
    known = on_screen(page, found.verdict)
    return replace(
        page, sections=(*(each for each in known if each.media != (NOTEBOOK,)), *sections)
    )


def _files(found: BuiltBoard) -> Iterator[tuple[str, str]]:
    texts = OWN if found.verdict is not None else OWN | {REPORT: "why there is no verdict"}
    yield from ((name, texts[name]) for name in found.files if name in texts)
    sheets = sum(name.endswith(".kicad_sch") for name in found.files)
    yield f"{KICAD}/{found.scene.name}.kicad_pro", f"the whole board for KiCad, {sheets} sheets"


def _notes(found: BuiltBoard) -> Iterator[str]:
    parts = found.parts
    yield counts_text(parts)
    if found.not_standard:
        yield "values are nominal; parts.csv has the nearest standard value beside each"
    yield packages_text(parts)
    yield from (f"not included: {what}" for what in parts.not_listed)
