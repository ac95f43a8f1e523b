"""The paper's reproduction as a Markdown page and as an HTML page that needs no other file."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from html import escape

from taction.verification.evidence.paper.findings import ClaimOutcome
from taction.verification.evidence.paper.pictures import Picture
from taction.verification.evidence.paper.reproduce import Reproduction, Section
from taction.verification.report.tables import markdown_line, markdown_table

TITLE = "The paper, claim by claim"
SOURCE = (
    "Y. C. Pati, P. S. Krishnaprasad and M. C. Peckerar, Neural network solutions to problems in"
    " early taction"
)
COLUMNS = ("claim", "place", "what was run", "printed", "ours", "verdict")
CLASSES = {
    ClaimOutcome.HOLDS: "holds",
    ClaimOutcome.FITTED: "fitted",
    ClaimOutcome.CONDITION: "condition",
    ClaimOutcome.FAILS: "fails",
    ClaimOutcome.NOT_RUN: "missing",
}
CSS = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 84em; padding: 0 1em;
       color: #222; background: #fff; }
table { border-collapse: collapse; width: 100%; margin: 1em 0; }
th, td { border-bottom: 1px solid #ddd; padding: .45em .6em; text-align: left;
         vertical-align: top; }
th { border-bottom: 2px solid #888; }
td:nth-child(1) { width: 22%; } td:nth-child(3) { width: 22%; } td:nth-child(5) { width: 28%; }
td:nth-child(6) { font-weight: 600; width: 9em; }
tr.holds td:nth-child(6) { color: #176b2c; } tr.condition td:nth-child(6) { color: #8a5a00; }
tr.fitted td:nth-child(6) { color: #1f4e8a; }
tr.fails td:nth-child(6) { color: #a51d1d; } tr.missing td:nth-child(6) { color: #7a1f8a; }
tr.unexpected { background: #fdecec; }
figure { margin: 1.5em 0; } img { max-width: 100%; height: auto; }
figcaption { color: #555; } footer { color: #555; font-size: .9em; margin-top: 2em; }
"""
Images = Mapping[str, bytes]


def paper_markdown(
    result: Reproduction, images: Images, summary: str, machine: Mapping[str, str]
) -> str:
    """Return the page as Markdown; its pictures stand beside it as ``NAME.png``."""
    return "\n".join(_markdown(result, images, summary, machine)) + "\n"


def _markdown(
    result: Reproduction, images: Images, summary: str, machine: Mapping[str, str]
) -> Iterator[str]:
    yield from (f"# {TITLE}", "", f"{SOURCE}.", "", markdown_line(summary))
    for section in result.sections:
        yield from ("", f"## {section.title}", "")
        yield from markdown_table(COLUMNS, (cells for _, cells in _rows(section)))
        for picture in _drawn(section, images):
            yield from ("", f"![{markdown_line(picture.caption)}]({picture.name}.png)")
            yield from ("", markdown_line(picture.caption))
    yield from ("", f"Made by `taction reproduce` in {result.seconds:.0f} s.", "")
    yield from (f"- {name}: {markdown_line(value)}" for name, value in machine.items())


def paper_html(
    result: Reproduction, images: Images, summary: str, machine: Mapping[str, str]
) -> str:
    """Return the page as HTML with its pictures inside."""
    return "\n".join(_html(result, images, summary, machine)) + "\n"


def _html(
    result: Reproduction, images: Images, summary: str, machine: Mapping[str, str]
) -> Iterator[str]:
    yield '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<title>{TITLE}</title><style>{CSS}</style></head><body>"
    yield f"<h1>{TITLE}</h1><p>{escape(SOURCE)}.</p><p>{escape(summary)}</p>"
    for section in result.sections:
        yield f"<h2>{escape(section.title)}</h2>"
        yield f"<table><thead>{_cells('th', COLUMNS)}</thead><tbody>"
        for kind, cells in _rows(section):
            yield _cells("td", cells, kind)
        yield "</tbody></table>"
        for picture in _drawn(section, images):
            data = base64.b64encode(images[picture.name]).decode("ascii")
            caption = escape(picture.caption)
            yield f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
            yield f"<figcaption>{caption}</figcaption></figure>"
    facts = "; ".join(f"{name} {value}" for name, value in machine.items())
    yield f"<footer>Made by taction reproduce in {result.seconds:.0f} s. {escape(facts)}</footer>"
    yield "</body></html>"


def _drawn(section: Section, images: Images) -> list[Picture]:
    return [picture for picture in section.pictures if picture.name in images]


def _rows(section: Section) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the CSS class and the cells of the row of every claim."""
    for each in section.judged:
        claim, finding = each.claim, each.finding
        verdict, kind = finding.outcome.value, CLASSES[finding.outcome]
        if not each.as_expected:
            verdict, kind = f"{verdict} (expected: {claim.expected.value})", f"{kind} unexpected"
        cells = (claim.claim, claim.place, finding.run, claim.printed, finding.ours, verdict)
        yield kind, cells


def _cells(tag: str, cells: tuple[str, ...], kind: str = "") -> str:
    row = f'<tr class="{kind}">' if kind else "<tr>"
    return row + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"
