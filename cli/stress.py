"""``taction stress``: the stiff and extreme cases on this machine."""

from __future__ import annotations

import sys

import click

from taction.cli.common import JOBS, command, console, print_json, stage_display


@command
@click.option(
    "--only", multiple=True, metavar="NAME", help="Run one case, or one family; repeatable."
)
@click.option("--junit", type=click.Path(), metavar="FILE", help="Write a JUnit XML report.")
@click.option("--page", type=click.Path(), metavar="FILE", help="Write a page in Markdown.")
@JOBS
def stress(
    only: tuple[str, ...], junit: str | None, page: str | None, jobs: int | None, as_json: bool
) -> None:
    """Verify the catalogue of stiff and extreme scenes, whose right results are known.

    Every outcome is compared with the right outcome, and every number with its true value. So a run
    shows whether ngspice and the numerical libraries of this machine give right answers. Numbers
    outside their stated uncertainty are counted; a number is wrong that misses its true value by
    more than the uncertainty and the accuracy that the scene asks for.

    Exit status: 1 if an outcome or a number is wrong, 3 if ngspice is missing.
    """
    from taction.system.atomic_files import write_atomically
    from taction.verification.evidence.stress.catalogue import load_catalogue, select
    from taction.verification.evidence.stress.run import expected_seconds, run_catalogue
    from taction.verification.report.junit import stress_junit
    from taction.verification.report.stress.page import stress_page
    from taction.verification.report.stress.report import print_stress, stress_document

    cases = select(load_catalogue(), only)
    seconds = expected_seconds(cases, jobs)
    click.echo(f"taction: {len(cases)} cases, about {seconds:.0f} s", err=True)
    with stage_display() as progress:
        report = run_catalogue(cases, progress, jobs)
    for file, text in ((junit, stress_junit), (page, stress_page)):
        if file is not None:
            write_atomically(file, text(report))
            click.echo(f"wrote {file}", err=True)
    if as_json:
        print_json(stress_document(report))
    else:
        print_stress(report, console())
    if report.interrupted:
        click.echo("taction: interrupted; the finished cases are in the report", err=True)
    sys.exit(report.exit_status)
