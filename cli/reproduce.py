"""``taction reproduce``: the paper, claim by claim and figure by figure."""

from __future__ import annotations

import sys

import click

from taction.cli.common import STATUS, command, console, print_json, stage_display


@command
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Write paper.md, paper.html (self-contained) and the pictures into DIR.",
)
@click.option("--quick", is_flag=True, help="Run fewer seeds and sizes, for CI.")
def reproduce(output: str | None, quick: bool, as_json: bool) -> None:
    """Test every claim of the paper.

    Exit status: 1 if a verdict differs from the verdict that taction has on record, 3 if a claim
    could not be tested.
    """
    from taction.verification.evidence.paper.reproduce import reproduce as run
    from taction.verification.report.paper.report import (
        check_report_folder,
        paper_document,
        print_paper,
        write_paper,
    )

    if output is not None:
        check_report_folder(output)
    with stage_display(every=True) as progress:
        result = run(quick=quick, progress=progress)
    if output is not None:  # before the text: its reader may go
        names = write_paper(result, output)
        click.echo(f"wrote {', '.join(names)} into {output}", err=True)
    if as_json:
        print_json(paper_document(result))
    else:
        print_paper(result, console())
    sys.exit(STATUS[result.outcome])
