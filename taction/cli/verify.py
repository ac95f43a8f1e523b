"""``taction verify``: one scene with the changes that mend it, or several scenes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import taction
from taction.cli.command import (
    OPTIONS,
    REPORT,
    Call,
    Command,
    NumberRange,
    argument,
    is_of_stdout,
    load,
    option,
    picture,
    text_file,
)
from taction.cli.printing import StageLine, put, say
from taction.system.errors import Interrupted
from taction.system.progress import attempt

if TYPE_CHECKING:
    from taction.verification.design.remedies import Remedies

DOCUMENTS = "verification.report.documents"
DOCUMENT = f"{DOCUMENTS}.verdict:verdict_document"


@dataclass(frozen=True, slots=True)
class Verified:
    """The verdict of one scene, with what the options of ``taction verify`` add."""

    verdict: taction.Verdict
    document: dict[str, Any]
    whole: bool = False  # by --verbose
    remedies: Remedies | None = None

    @property
    def outcome(self) -> str:
        """Of the verdict."""
        return str(self.verdict.outcome.value)

    def changes(self, *, whole: bool) -> list[str]:
        """Return the changes that mend the verdict as lines below a heading: all, or the first."""
        if self.remedies is None:
            return []
        from taction.verification.report.views.design_view import remedies_text
        from taction.verification.report.views.verdict_view import CHANGES

        lines = remedies_text(self.verdict.scene, self.remedies).splitlines()
        rest = 0 if whole else max(len(lines) - CHANGES, 0)
        return [*lines[: len(lines) - rest], *[f"  and {rest} more: -v"] * bool(rest)]


def verify_scene(call: Call, progress: StageLine) -> Verified:
    """Verify the scene, print the verdict, and search for changes if it fails."""
    options = call.options
    scene, given = options["scenes"][0], {name: options[name] for name in ("engine", "settings")}
    verdict = taction.verify(scene, **given, progress=progress)
    for text in verdict.scene.written_questions * bool(options["settings"]):
        say(text)
    document: dict[str, Any] = {}
    if call.as_json or options["margins"]:
        document = load(DOCUMENT + "_with_margins" * bool(options["margins"]))(verdict)
    found = Verified(verdict, document, options["verbose"])
    if not call.as_json:
        attempt("the text", partial(_print_verdict, found, progress), None, say, is_of_stdout)
    changes = options["changes"]
    search = partial(taction.what_to_change, verdict, changes=changes, progress=progress)
    try:
        return replace(found, remedies=attempt("the search for changes", search, None, say))
    except KeyboardInterrupt:
        raise Interrupted("the verdict stands, the search for changes was ended", found) from None


def _print_verdict(found: Verified, progress: StageLine) -> None:
    """Print a verdict but for its last line; a reader who has gone is met at the end."""
    from taction.verification.report.renderers.terminal import page_lines
    from taction.verification.report.views.answer_view import margin_lines
    from taction.verification.report.views.verdict_view import screen, view

    verdict, margins = found.verdict, tuple(margin_lines(found.document))
    page = view(verdict, notes=margins, verbose=True) if found.whole else screen(verdict, margins)
    with progress.aside(), suppress(BrokenPipeError):
        for line in [*page_lines(page)][:-1]:
            put(line)


def _print_changes(found: Verified) -> None:
    """Print what mends a verdict that is printed, and its outcome as the last line."""
    from taction.verification.report.renderers.terminal import outcome_line

    for line in (*found.changes(whole=found.whole), outcome_line(found.outcome)):
        put(line)


def _write_report(found: Verified, path: str) -> None:
    from taction.verification.report.renderers.page import write_page
    from taction.verification.report.views.verdict_view import view

    write_page(view(found.verdict, changes="\n".join(found.changes(whole=True))), path)


def _document(found: Verified) -> object:
    more = {} if found.remedies is None else {"what_to_change": found.remedies}
    return found.document | more


def _several(options: Mapping[str, Any]) -> Command | None:
    """Return the job of several scenes; None for one scene."""
    scenes = options["scenes"]
    if len(scenes) == 1 and not Path(scenes[0]).is_dir() and options["junit"] is None:
        return None
    if options["settings"]:
        raise click.UsageError("--set is for one scene: several may have different keys")
    return VERIFY_FILES


JUNIT = text_file("junit", "Write a JUnit XML report.", "verification.report.junit:files_junit")
VERIFY_FILES = Command(
    function="verify_files",
    document=f"{DOCUMENTS}.plain:VerifyFilesDocument",
    outputs=(JUNIT,),
    schema="verify-files",
    lacks="shows one board; give one scene file, without --junit",
)
VERIFY = Command(
    about="Simulate a board and check it against the solution.",
    work=verify_scene,
    document=_document,
    text=_print_changes,
    outputs=(
        replace(
            picture("outputs, settling band and recovered stress"),
            write=lambda found, path: found.verdict.plot(path),
        ),
        replace(REPORT, write=_write_report),
    ),
    other=_several,
    python_only=("scene",),
    parameters=(
        argument("scenes", metavar="SCENE...", nargs=-1, required=True),
        option("margins", is_flag=True, of="verify_files"),
        JUNIT,
        replace(OPTIONS["jobs"], of="verify_files"),
        option("changes", type=NumberRange(0), metavar="DESIGNS", of="what_to_change"),
        option(
            "verbose",
            "-v",
            "--verbose",
            is_flag=True,
            help="Show the tables of checks, channels and op-amps, all warnings, the error budget,"
            " and how the record and the reference were made.",
        ),
    ),
    ends="SCENE is a scene file, or a folder: all its files *.toml. Several scenes give one table,"
    " and with --json one document. Exit status: the first of 2, 1, 3, 0 that a scene has.\n\n"
    "The verdict of one scene that fails ends with the nearest changes of the design that mend it.",
)
