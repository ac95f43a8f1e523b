"""A page as one HTML file that needs no network.

Plotly's program is part of the file, compressed to less than half of its size; the browser
unpacks it. The page has a policy that lets the browser run only the two programs of this file,
known by their digests, and load nothing: a text that became markup by mistake could do nothing.
"""

from __future__ import annotations

import base64
import functools
import gzip
import hashlib
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.system.foreign_files import escaped, visible
from taction.system.output_files import check_file, write_atomically
from taction.verification.report.blocks import PAGE as MEDIUM
from taction.verification.report.blocks import Block, Page, Section
from taction.verification.report.renderers.plotly import plotly_spec

if TYPE_CHECKING:
    from jinja2 import Environment

FILES = Path(__file__).parent / "page_files"


def write_page(page: Page, path: str) -> None:
    """Write `page` to `path`; InputError as `check_file`, or the file cannot be written."""
    check_file(path, "--report")
    write_atomically(path, page_html(page))


def page_html(page: Page) -> str:
    """Return `page` as the text of one HTML file."""
    program = _read("charts.js") + _read("page.js")
    shown = made_sections(page)
    charts = any(block.kind == "chart" for _, own in shown for block in own)
    packed, digest = _plotly() if charts else ("", "")
    return (
        templates()
        .get_template("page.html")
        .render(
            page=page,
            sections=shown,
            style=_read("page.css"),
            program=program,
            plotly=packed,
            digests=[_digest(program.encode()), digest],
        )
    )


@functools.cache
def templates(*folders: Path) -> Environment:
    """Return the templates of the pages and those of `folders`; what they show is escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import escape

    made = Environment(
        loader=FileSystemLoader([FILES, *folders]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    code = {"code": lambda text: escape(escaped(text, "\n\t"))}  # its lines stay
    made.filters |= {"spec": plotly_spec, **code}
    return made


def _shown(value: Any) -> Any:
    """Return what the page shows of a value; its own markup and its programs stay."""
    known = not isinstance(value, str) or hasattr(value, "__html__")
    return value if known else visible(value)


def made_sections(page: Page) -> list[tuple[Section, list[Block]]]:
    """Return the sections with blocks; neighbours of one title are one."""
    found: list[tuple[Section, list[Block]]] = []
    for section in page.sections:
        blocks = section.made(MEDIUM)
        if blocks and found and found[-1][0].title == section.title:
            found[-1][1].extend(blocks)
        elif blocks:
            found.append((section, [*blocks]))
    return found


def _read(name: str) -> str:
    return (FILES / name).read_text("utf-8")


def _digest(program: bytes) -> str:
    """Return the digest of a program, as a Content Security Policy has it."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(program).digest()).decode()}'"


@functools.cache
def _plotly() -> tuple[str, str]:
    """Return Plotly's program, compressed and as Base64, and the digest of the program."""
    source: Any = files("plotly") / "package_data" / "plotly.min.js"
    program = source.read_bytes()
    packed = gzip.compress(program, 9, mtime=0)
    return base64.b64encode(packed).decode(), _digest(program)
