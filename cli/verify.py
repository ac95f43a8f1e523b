"""``taction verify``: from scenes to verdicts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import taction
from taction.cli.common import (
    ENGINE,
    JOBS,
    STATUS,
    check_plot,
    check_report,
    command,
    console,
    plot_option,
    print_json,
    report_option,
    save_report,
    stage_display,
    write_all,
)
from taction.system.errors import Complaint, InputError

if TYPE_CHECKING:
    from taction.verification.design.remedies import Remedies
    from taction.verification.report.html.blocks import Report


@command
@click.argument("scenes", metavar="SCENE...", nargs=-1, required=True, type=click.Path())
@ENGINE
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Another value for a key of one scene: C=12pF, lambda=0.5, design.opamp=tl084. Repeat it"
    " for several keys.",
)
@plot_option("outputs, settling band and recovered stress")
@report_option()
@click.option(
    "--margins",
    is_flag=True,
    help="Show by what factor C may shrink and the gain may grow until the board oscillates; of an"
    " unstable board, how far it is from stability in C, gain, stray capacitance and bandwidth.",
)
@click.option(
    "--exclude",
    multiple=True,
    metavar="PATTERN",
    help="Leave out files whose name or path matches: 'draft-*'. Repeat it for several patterns.",
)
@click.option("--junit", type=click.Path(), metavar="FILE", help="Write a JUnit XML report.")
@click.option(
    "--annotate/--no-annotate",
    envvar="GITHUB_ACTIONS",
    default=False,
    help="Print errors and warnings on stderr as GitHub shows them at the files; by default where"
    " GITHUB_ACTIONS is set.",
)
@JOBS
@click.option(
    "--changes",
    type=click.FloatRange(0),
    default=4.0,
    metavar="SECONDS",
    help="Time limit of the search for changes that mend a failed verdict; 0: no search.",
)
@click.option(
    "-v", "--verbose", is_flag=True, help="Show also how the record and the reference were made."
)
def verify(scenes: tuple[str, ...], as_json: bool, **options: Any) -> None:
    """Simulate the board of each SCENE, solve its problem, and check the board.

    SCENE is a scene file, or a folder: all its files *.toml. Several scenes give one table, and
    with --json one document. Exit status: the first of 2, 1, 3, 0 that a scene has.

    The verdict of one scene that fails ends with the nearest changes of the design that mend it.
    """
    check_plot(options["plot"])
    check_report(options["report"])
    single = len(scenes) == 1 and not Path(scenes[0]).is_dir() and not options["exclude"]
    if options["settings"] and not (single and options["junit"] is None):
        raise click.UsageError("--set is for one scene: several may have different keys")
    if single and options["junit"] is None:
        _verify_one(scenes[0], as_json, options)
    else:
        _verify_files(scenes, as_json, options)


def _verify_one(scene: str, as_json: bool, options: dict[str, Any]) -> None:
    from taction.verification.report.files.reasons import margin_lines

    with stage_display() as progress:
        try:
            verdict = taction.verify(
                _with_settings(scene, options["settings"]),
                engine=options["engine"],
                progress=progress,
            )
        except taction.TactionError as error:
            if options["annotate"]:
                from taction.system.error_document import error_document

                _annotate({"file": scene, **error_document(error)})
            raise
        remedies = _remedies(verdict, options["changes"], progress)
    plain = not (as_json or options["margins"] or options["annotate"])
    document = {} if plain else _description(options["margins"])(verdict)
    if options["plot"] is not None:  # before the text: its reader may go
        from taction.verification.report.verdict.plots import plot_verdict

        plot_verdict(verdict, options["plot"])
        click.echo(f"drew {options['plot']}", err=True)
    save_report(options["report"], lambda: _report(verdict, remedies))
    if options["annotate"]:
        _annotate(document)
    if as_json:
        if remedies is not None:
            from taction.verification.report.verdict.remedies import remedies_document

            document["what_to_change"] = remedies_document(remedies)
        print_json(document)
    else:
        from taction.verification.report.verdict.table import print_verdict

        print_verdict(verdict, console(), verbose=options["verbose"])
        if remedies is not None:
            from taction.verification.report.verdict.remedies import remedies_text

            click.echo(remedies_text(verdict.scene, remedies))
        for line in margin_lines(document):
            click.echo(line)
    sys.exit(STATUS[verdict.outcome.value])


def _with_settings(scene: str, settings: tuple[str, ...]) -> str | taction.Scene:
    if not settings:
        return scene
    from taction.netlist_gen.scene.settings import with_settings

    return with_settings(taction.load_scene(scene), settings)


def _remedies(
    verdict: taction.Verdict, seconds: float, progress: Callable[[str], None]
) -> Remedies | None:
    """Return the changes that mend a failed verdict, found within `seconds`."""
    if not seconds or verdict.outcome.value != "fail":
        return None
    from taction.verification.design.remedies import find_remedies

    progress("what to change")
    return find_remedies(verdict, seconds)


def _report(verdict: taction.Verdict, remedies: Remedies | None) -> Report:
    from taction.verification.report.html.verdict_report import verdict_report
    from taction.verification.report.verdict.remedies import remedies_text

    changes = "" if remedies is None else remedies_text(verdict.scene, remedies)
    return verdict_report(verdict, changes=changes)


def _verify_files(scenes: tuple[str, ...], as_json: bool, options: dict[str, Any]) -> None:
    from taction.verification.report.files.table import files_document, print_files
    from taction.verification.report.junit import files_junit
    from taction.verification.studies.scene_files import scene_files
    from taction.verification.studies.verify_files import verify_files

    junit = options["junit"]
    for name in ("plot", "report"):
        if options[name] is not None:
            text = "shows one board; give one scene file, without --exclude and --junit"
            raise InputError(f"--{name}", Complaint("FILE", repr(options[name]), text))
    describe = _description(options["margins"])
    files = scene_files(scenes, options["exclude"])
    with stage_display() as progress:
        result = verify_files(
            files, describe, engine=options["engine"], jobs=options["jobs"], progress=progress
        )
    written = junit is None or write_all({junit: lambda: files_junit(result)})
    if as_json:
        print_json(files_document(result), "verify-files")
    else:
        print_files(result, console())
    if options["annotate"]:
        for document in result.documents:
            _annotate(document)
    if result.interrupted:
        click.echo("taction: interrupted; the finished scenes are in the report", err=True)
    sys.exit(result.exit_status if written else STATUS["bad input"])


def _description(margins: bool) -> Callable[[Any], dict[str, Any]]:
    if margins:
        from taction.verification.report.verdict.margins import verdict_document_with_margins

        return verdict_document_with_margins
    from taction.verification.report.verdict.json_document import verdict_document

    return verdict_document


def _annotate(document: dict[str, Any]) -> None:
    from taction.verification.report.files.annotations import annotation_lines

    for line in annotation_lines(document):
        click.echo(line, err=True)
