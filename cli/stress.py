"""``taction stress``: the stiff and extreme cases on this machine."""

from __future__ import annotations

import sys

import click

from cli.common import command, console, print_json, stage_display

WIDTH = 140  # columns of a table in a file or a pipe


@command
@click.option(
    "--only", multiple=True, metavar="NAME", help="Run one case, or one family; repeatable."
)
@click.option("--junit", type=click.Path(), metavar="FILE", help="Write a JUnit XML report.")
def stress(only: tuple[str, ...], junit: str | None, as_json: bool) -> None:
    """Verify the catalogue of stiff and extreme scenes, whose right results are known.

    Every outcome is compared with the right outcome, and every number with its true value, which
    must be within the stated uncertainty. So a run shows whether ngspice and the numerical
    libraries of this machine give right answers.

    Exit status: 1 if an outcome or a number is wrong, 3 if ngspice is missing.
    """
    from verification.report.atomic_files import check_folder, write_atomically
    from verification.report.stress.report import print_stress, stress_document, stress_junit
    from verification.studies.stress.catalogue import load_catalogue, select
    from verification.studies.stress.run import expected_seconds, run_catalogue

    if junit is not None:
        check_folder(junit, "--junit")
    cases = select(load_catalogue(), only)
    seconds = expected_seconds(cases)
    click.echo(f"taction: {len(cases)} cases, about {seconds:.0f} s", err=True)
    with stage_display() as progress:
        report = run_catalogue(cases, progress)
    if junit is not None:
        write_atomically(junit, stress_junit(report))
        click.echo(f"wrote {junit}", err=True)
    if as_json:
        print_json(stress_document(report))
    else:
        page = console()
        if not page.is_terminal:
            page.width = WIDTH
        print_stress(report, page)
    if report.interrupted:
        click.echo("taction: interrupted; the finished cases are in the report", err=True)
    sys.exit(report.exit_status)
