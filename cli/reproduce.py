"""``taction reproduce``: the paper, claim by claim and figure by figure."""

from __future__ import annotations

import sys

import click

from cli.common import STATUS, json_option, print_json, reports_errors, stage_display

WIDTH = 160


@click.command(short_help="The paper, claim by claim and figure by figure.")
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Write paper.md, paper.html (self-contained) and the pictures there.",
)
@click.option("--quick", is_flag=True, help="Fewer seeds and sizes, for CI.")
@json_option
@reports_errors
def reproduce(output: str | None, quick: bool, as_json: bool) -> None:
    """Run every claim of the paper and judge it.

    Ends with 1 where a verdict is not the one that taction stands by, with 3 where something
    could not be run.
    """
    from verification.report.paper.report import (
        check_report_folder,
        paper_document,
        print_paper,
        write_paper,
    )
    from verification.studies.paper.reproduce import reproduce as run

    if output is not None:
        check_report_folder(output)
    with stage_display() as progress:
        found = run(quick=quick, progress=progress)
    if as_json:
        print_json(paper_document(found))
    else:
        from rich.console import Console

        console = Console(highlight=False)
        if not console.is_terminal:  # a file or a pipe: five columns of text need room
            console.width = WIDTH
        print_paper(found, console)
    if output is not None:
        names = write_paper(found, output)
        click.echo(f"wrote {', '.join(names)} into {output}", err=True)
    sys.exit(STATUS[found.outcome])
