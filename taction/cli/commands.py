"""The table of commands: the public function of each, its options, and what shows the result."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import taction
from taction.cli.command import (
    FILE,
    FOLDER,
    OPTIONS,
    REPORT,
    Command,
    NumberRange,
    Options,
    argument,
    is_of_stdout,
    load,
    option,
    output,
    own_file,
    picture,
    text_file,
)
from taction.cli.printing import StageLine, console, print_json, say, tell
from taction.system.errors import Interrupted
from taction.system.foreign_files import visible
from taction.system.progress import attempt
from taction.system.results import Result

if TYPE_CHECKING:
    from taction.verification.design.fresh_scene import NewScene
    from taction.verification.design.remedies import Remedies
    from taction.verification.report.blocks import Page
    from taction.verification.studies.regression.regress import RegressionReport

JUNIT = "verification.report.junit"


@dataclass(frozen=True, slots=True)
class Verified(Result):
    """The verdict of one scene, with what the options of ``taction verify`` add."""

    DOCUMENT = "taction.cli.commands:Verified.whole_document"

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
        from taction.verification.report.views.answer_view import CHANGES
        from taction.verification.report.views.design_view import remedies_text

        lines = remedies_text(self.verdict.scene, self.remedies).splitlines()
        rest = 0 if whole else max(len(lines) - CHANGES, 0)
        return [*lines[: len(lines) - rest], *[f"  and {rest} more: -v"] * bool(rest)]

    def page(self) -> Page:
        """Return the page of the verdict with all changes."""
        from taction.verification.report.views.verdict_view import view

        return view(self.verdict, changes="\n".join(self.changes(whole=True)))

    def whole_document(self) -> dict[str, Any]:
        """Return the document of the verdict with the changes."""
        more = {} if self.remedies is None else {"what_to_change": self.remedies}
        return self.document | more


def verify_scene(options: Options, progress: StageLine) -> Verified:
    """Verify the scene, print the verdict, and search for changes if it fails."""
    scene, given = options["scenes"][0], {name: options[name] for name in ("engine", "settings")}
    verdict = taction.verify(scene, **given, progress=progress)
    for text in verdict.scene.written_questions * bool(options["settings"]):
        say(text)
    document: dict[str, Any] = {}
    if options["as_json"] or options["margins"]:
        place = "verification.report.documents.verdict:verdict_document"
        document = load(place + "_with_margins" * bool(options["margins"]))(verdict)
    found = Verified(verdict, document, options["verbose"])
    if not options["as_json"]:
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
    from taction.verification.report.views.answer_view import margin_lines, screen

    verdict, margins = found.verdict, tuple(margin_lines(found.document))
    if found.whole:
        from taction.verification.report.views.verdict_view import view

        page = view(verdict, notes=margins, verbose=True)
    else:
        page = screen(verdict, margins)
    with progress.aside(), suppress(BrokenPipeError):
        for line in [*page_lines(page)][:-1]:
            console().print(line)


def _print_changes(found: Verified) -> None:
    """Print what mends a verdict that is printed, and its outcome as the last line."""
    from taction.verification.report.renderers.terminal import outcome_line

    for line in (*found.changes(whole=found.whole), outcome_line(found.outcome)):
        console().print(line)


def _several(options: Options) -> Command | None:
    """Return the job of several scenes; None for one scene."""
    scenes = options["scenes"]
    if len(scenes) == 1 and not Path(scenes[0]).is_dir() and options["junit"] is None:
        return None
    if options["settings"]:
        raise click.UsageError("--set is for one scene: several may have different keys")
    return VERIFY_FILES


def _announce(options: Options) -> None:
    """Say the address of the page as soon as it can be opened."""

    def announce(address: str) -> None:
        if options["as_json"]:
            print_json({"address": address}, "explore")
        else:
            click.echo(address)
        say("Ctrl-C ends the explorer")

    options["announce"] = announce


def _choice_database(options: Options) -> None:
    """Name the database after the scene."""
    options["store"] = options["store"] or f"{options['scene'].name}-choose.sqlite"


def _check_sweep(options: Options) -> None:
    """Refuse axes that cannot be drawn, and name the database after the scene's file."""
    if options["plot"] is not None:
        from taction.verification.report.views.sweep_view import check_axes

        check_axes(len(options["over"]), options["plot"])
    options["output"] = options["output"] or f"{options['scene'].file.stem}.sqlite"


def _regression_markdown(found: RegressionReport) -> str:
    from taction.verification.report.renderers.terminal import markdown

    return markdown(found.page(), "taction regress")


def _new_files(found: NewScene, options: Options) -> list[str]:
    if found.scaled is not None:
        return [found.file]
    return [f"{found.file}; `taction verify {found.file}` verifies it"]


FILES_JUNIT = text_file("junit", "Write a JUnit XML report.", f"{JUNIT}:files_junit")
VERIFY_FILES = Command(
    function="verify_files",
    outputs=(FILES_JUNIT,),
    schema="verify-files",
    lacks="shows one board; give one scene file, without --junit",
)
NEW_MATRIX = Command(function="new", schema="new-matrix", files=_new_files)
TABLE = {
    "verify": Command(
        about="Simulate a board and check it against the solution.",
        work=verify_scene,
        text=_print_changes,
        outputs=(picture("outputs, settling band and recovered stress"), REPORT),
        other=_several,
        python_only=("scene",),
        parameters=(
            argument("scenes", metavar="SCENE...", nargs=-1, required=True),
            option("margins", is_flag=True, of="verify_files"),
            FILES_JUNIT,
            replace(OPTIONS["jobs"], of="verify_files"),
            option("changes", type=NumberRange(0), metavar="DESIGNS", of="what_to_change"),
            option(
                "verbose",
                "-v",
                "--verbose",
                is_flag=True,
                help="Show the tables of checks, channels and op-amps, all warnings, the error"
                " budget, and how the record and the reference were made.",
            ),
        ),
        ends="SCENE is a scene file, or a folder: all its files *.toml. Several scenes give one"
        " table, and with --json one document. Exit status: the first of 2, 1, 3, 0 that a scene"
        " has.\n\nThe verdict of one scene that fails ends with the nearest changes of the design"
        " that mend it.",
    ),
    "check": Command(
        about="Find poles, onset, settling and noise of a SPICE deck.",
        outputs=(picture("step response and poles"), REPORT),
        parameters=(option("over", metavar="NAME[=LOW:HIGH:N]", multiple=True),),
        ends="Exit status: 0 without checks or if all pass, 1 a check failed, 3 one is not"
        " decided.",
    ),
    "diff": Command(
        about="Compare the keys and the readings of two boards.",
        outputs=(picture("the outputs of both over each other"), REPORT),
        parameters=(argument("first", metavar="A"), argument("second", metavar="B")),
        ends="Exit status: 0 if all readings are equal within their uncertainties, 1 if one is"
        " not, 3 if that is unknown.",
    ),
    "netlist": Command(
        about="Write the ngspice deck of a scene.",
        text=lambda found: None if found.written else sys.stdout.write(found.text),
        after=lambda found: tell(f"warning: {visible(each)}" for each in found.warnings),
        files=own_file,
    ),
    "bom": Command(about="List the parts to buy, with packages and power.", files=own_file),
    "build": Command(
        about="Write all files for building a board, with its verdict.",
        files=lambda found, options: [found.folder],
        parameters=(FOLDER,),
        ends="Exit status: that of the verdict.",
    ),
    "solve": Command(
        about="Solve the problem numerically, with a certificate.",
        ends="Exit status: 3 if the solution has no certificate.",
    ),
    "simulate": Command(
        about="Verify a board, and write the waveforms of its record.",
        text=lambda found: sys.stdout.write(f"{found}\n"),
        files=own_file,
        ends="Exit status: that of the verdict.",
    ),
    "montecarlo": Command(
        about="Estimate the yield under component tolerances.",
        outputs=(picture("histograms with limits"), REPORT),
        ends="Exit status with --min-yield: 0 if the whole 95 % interval of the yield lies above"
        " that value, 1 if it lies below, else 3. Without --min-yield: 0.",
    ),
    "corners": Command(
        about="Find the worst cases within the tolerances.",
        outputs=(REPORT,),
        ends="Exit status: 1 if a corner fails, else 3 if a corner has no verdict.",
    ),
    "explore": Command(
        about="Move C, gain and more on a local page and watch the board.",
        before=_announce,
        after=lambda found: say("ended"),
    ),
    "tune": Command(
        about="Find the gain with the least settling time.",
        outputs=(picture("outputs and settling band of the design"), REPORT),
        files=own_file,
        parameters=(option("overshoot", type=NumberRange(0, min_open=True)),),
    ),
    "choose": Command(
        about="Choose op-amp, C and gain for given limits.",
        outputs=(picture("maps of C and gain for every op-amp"), REPORT),
        before=_choice_database,
        files=lambda found, options: [one.file for one in found.best if one.file],
        parameters=(option("overshoot", metavar="SHARE"), option("noise", metavar="VOLTS"), FOLDER),
        ends="Exit status: 0 if a design passes on both engines, 1 if none passes.",
    ),
    "scale": Command(about="Propose G0, U0, s and R for op-amps and supply.", files=own_file),
    "onset": Command(
        about="Find every stability crossing over a range.",
        outputs=(picture("root locus, damping and frequency over the value"), REPORT),
        parameters=(option("over", metavar="KEY[=LOW:HIGH:N]"),),
        ends="Exit status: 0 if the question was answered, 3 if a transient contradicts a"
        " crossing.",
    ),
    "sweep": Command(
        about="Verify a grid of scenes, here or on a cluster; resumable.",
        outputs=(
            output(
                "export",
                "Write a table (.csv, .parquet).",
                "verification.studies.sweep:export_sweep",
            ),
            picture("maps over two axes, or curves over one axis,"),
            REPORT,
        ),
        before=_check_sweep,
        parameters=(option("over", multiple=True, metavar="KEY=LOW:HIGH:N"),),
        ends="Exit status: 0 if every point is stored, whatever its outcome; with --strict 1 if a"
        " point fails; 3 if no point has a verdict.",
    ),
    "regress": Command(
        about="Compare a folder of scenes with a stored baseline, for CI.",
        outputs=(
            text_file("junit", "Write a JUnit XML report.", f"{JUNIT}:regression_junit"),
            text_file("markdown", "Write a Markdown summary.", _regression_markdown),
            REPORT,
        ),
        files=lambda found, options: [options["baseline"]] if found.updated else [],
        parameters=(argument("folder", metavar="DIR"),),
        ends="Exit status: 1 if a check failed, or if a result differs from the baseline by more"
        " than the scene's table [regression] allows. --update stores differences, but"
        " leaves a scene with a failed check as it was.",
    ),
    "stress": Command(
        about="Run stiff and extreme scenes whose results are known.",
        outputs=(REPORT,),
        ends="Exit status: 1 if an outcome or a number is wrong, 3 if ngspice is missing.",
    ),
    "accuracy": Command(
        about="Compare error and run time of engines and methods.",
        outputs=(picture("error against run time"), REPORT),
        ends="Exit status: 3 if no run of the board ended within the budget.",
    ),
    "reproduce": Command(
        about="Test the paper, claim by claim and figure by figure.",
        outputs=(REPORT,),
        ends="Exit status: 1 if a verdict differs from the verdict that taction has on record, 3 if"
        " a claim could not be tested.",
    ),
    "demo": Command(
        about="Tell the paper's story on three boards; no file is needed.",
        outputs=(picture("the outputs of the three boards"),),
        files=lambda found, options: [found.file] if found.file else [],
        ends="Exit status: 0 if the boards behave as told.",
    ),
    "models": Command(
        about="List the op-amp presets, or import a vendor's model.",
        view="verification.report.views.opamp_view:list_view",
        commands={
            "show": Command(
                function="opamp",
                outputs=(picture("the Bode diagram of the open loop"),),
                parameters=(argument("name", type=str, reads=False),),
            ),
            "import": Command(function="import_model", files=lambda found, options: [found.file]),
        },
    ),
    "mcp": Command(about="Serve verify, check, onset and more to a program, by MCP."),
    "new": Command(
        about="Write a scene file with comments.",
        text=lambda found: None,  # the file is the result
        files=_new_files,
        other=lambda options: None if options["matrix"] is None else NEW_MATRIX,
        parameters=(
            argument("file", metavar="[FILE]", type=FILE, required=False, reads=False, writes=True),
            option("noise", metavar="SIGMA"),
            option("lam", "--lambda", type=NumberRange(0, min_open=True)),
            option("prune", type=NumberRange(0, 1, max_open=True)),
        ),
    ),
}
COMMANDS = {
    name: each if each.function else replace(each, function=name) for name, each in TABLE.items()
}
"""By name. All of these names work; `SECTIONS` are those that --help lists."""
