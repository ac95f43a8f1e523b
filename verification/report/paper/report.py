"""The paper's reproduction as JSON, as a table, and as a folder with Markdown, HTML and PNG."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from taction.system.atomic_files import write_atomically
from taction.verification.evidence.paper.reproduce import Reproduction
from taction.verification.report.blocks import TERMINAL
from taction.verification.report.renderers.markdown import line, markdown
from taction.verification.report.renderers.page import PACKAGES, write_page
from taction.verification.report.renderers.picture import draw_sheet
from taction.verification.report.views.paper import sheet, view
from taction.verification.studies.running.versions import describe_machine

MARKDOWN, HTML = "paper.md", "paper.html"
PAGES = (MARKDOWN, HTML)


def write_paper(result: Reproduction, folder: str) -> tuple[str, ...]:
    """Write `PAGES` and their pictures into `folder`; return the files' names.

    Without the packages of ``taction[report]`` there is no HTML page, and without matplotlib there
    are no pictures.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    page, names = view(result), list[str]()
    images: dict[str, list[tuple[str, str]]] = {}
    if importlib.util.find_spec("matplotlib") is not None:
        for section in result.sections:
            for picture in section.pictures:
                draw_sheet(sheet(picture), Path(folder) / f"{picture.name}.png")
                names.append(f"{picture.name}.png")
                images.setdefault(section.title, []).append((names[-1], picture.caption))
    text = markdown(page, medium=TERMINAL, images=images)
    machine = (f"- {name}: {line(str(value))}" for name, value in describe_machine().items())
    write_atomically(Path(folder) / MARKDOWN, "\n".join((text, *machine)) + "\n")
    if all(importlib.util.find_spec(name) for name in PACKAGES):
        write_page(page, str(Path(folder) / HTML))
        return (MARKDOWN, HTML, *names)
    return (MARKDOWN, *names)
