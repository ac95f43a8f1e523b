"""A page as Markdown: for a merge request, the summary of a CI job, the documentation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from taction.system.foreign_files import escaped, visible
from taction.verification.report import blocks

SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~&])")


def markdown(page: blocks.Page, heading: str = "", *, level: int = 1) -> str:
    r"""Return a page as Markdown.

    `heading` is in the place of the page's title, of a `level` above the sections.
    """
    lines = [f"{'#' * level} {line(heading or page.title)}"]
    for text in (*page.lines, page.summary):
        lines += ["", line(text)] if text else []
    for section in page.sections:
        lines += _section(section, section.made(blocks.TERMINAL), level + 1)
    return "\n".join(lines) + "\n"


def _section(section: blocks.Section, made: Sequence[blocks.Block], level: int) -> Iterator[str]:
    body = [text for block in made for text in _block(block, section.title, level + 1)]
    if body:
        yield from ("", f"{'#' * level} {line(section.title)}")
        if section.lead:
            yield from ("", line(section.lead))
        yield from body


def _block(block: blocks.Block, above: str, level: int) -> Iterator[str]:
    """Yield the lines of a block, the first of them empty; what Markdown cannot show has none."""
    if block.kind in ("chart", "drawing"):
        return
    if block.title and block.title != above:
        yield from ("", f"{'#' * level} {line(block.title)}")
    yield ""
    if isinstance(block, blocks.Table):
        yield from table(block.columns, ([cell.text for cell in row] for row in block.rows))
        if block.note:
            yield from ("", line(block.note))
    elif isinstance(block, blocks.Notes):
        yield from (f"- {line(part)}" for text in block.lines for part in text.split("\n"))
    elif isinstance(block, blocks.Facts):
        yield from (f"- {line(name)}: {line(value)}" for name, value in block.rows)
    elif isinstance(block, blocks.Bars):
        rows = ((bar.name, bar.outcome, bar.value, bar.limit, bar.reason) for bar in block.rows)
        yield from table(("check", "outcome", "value", "limit", "reason"), rows)
    elif isinstance(block, blocks.Code):
        text = escaped(block.text.rstrip("\n"), "\n\t").replace("```", "\\x60``")
        yield from ("```", text, "```")


def table(titles: Sequence[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    for cells in (map(line, titles), ["---"] * len(titles), *(map(line, row) for row in rows)):
        yield f"| {' | '.join(cells)} |"


def line(text: str) -> str:
    """Return `text` in one line, its special characters escaped for Markdown."""
    return SPECIAL.sub(r"\\\1", " ".join(visible(text).split()))
