"""The commands on one board, and those without a board: a table of public functions."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

import taction
from taction.cli.command import (
    ANNOTATE,
    FILE,
    OPTIONS,
    OUTPUT,
    REPORT,
    Call,
    Command,
    CommandParameter,
    Job,
    NumberRange,
    argument,
    folder,
    is_of_stdout,
    load,
    option,
    own_file,
    picture,
    text_file,
)
from taction.cli.printing import StageLine, print_json, put, say, tell
from taction.system.errors import Interrupted
from taction.system.foreign_files import visible
from taction.system.progress import attempt

if TYPE_CHECKING:
    from taction.verification.design.fresh_scene import NewScene
    from taction.verification.design.remedies import Remedies

DOCUMENTS = "verification.report.documents"
DOCUMENT = f"{DOCUMENTS}.verdict:verdict_document"


@dataclass(frozen=True, slots=True)
class Verified:
    """The verdict of one scene, with what the options of ``taction verify`` add."""

    verdict: taction.Verdict
    remedies: Remedies | None
    document: dict[str, Any]
    whole: bool = False  # by --verbose

    @property
    def outcome(self) -> str:
        """Of the verdict."""
        return str(self.verdict.outcome.value)


def verify_scene(call: Call, progress: StageLine) -> Verified:
    """Verify the scene, print the verdict, and search for changes if it fails."""
    options = call.options
    verdict = taction.verify(
        options["scenes"][0],
        engine=options["engine"],
        settings=options["settings"],
        progress=progress,
    )
    for text in verdict.scene.written_questions * bool(options["settings"]):
        say(text)
    document: dict[str, Any] = {}
    if call.as_json or options["margins"] or options["annotate"]:
        document = load(DOCUMENT + "_with_margins" * bool(options["margins"]))(verdict)
    found = Verified(verdict, None, document, whole=options["verbose"])
    if not call.as_json:
        attempt("the text", partial(_print_verdict, found, progress), None, say, is_of_stdout)
    given = {name: options[name] for name in ("changes", "any_part")}
    search = partial(taction.what_to_change, verdict, **given, progress=progress)
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
    whole = found.whole
    page = view(verdict, notes=margins, verbose=True) if whole else screen(verdict, margins)
    with progress.aside(), suppress(BrokenPipeError):
        for line in [*page_lines(page)][:-1]:
            put(line)


def _print_changes(found: Verified) -> None:
    """Print what mends a verdict that is printed, and its outcome as the last line."""
    from taction.verification.report.renderers.terminal import outcome_line

    for line in (*change_lines(found, whole=found.whole), outcome_line(found.outcome)):
        put(line)


def change_lines(found: Verified, *, whole: bool) -> list[str]:
    """Return the changes that mend a verdict as lines below a heading: all, or the first."""
    if found.remedies is None:
        return []
    from taction.verification.report.views.design_view import remedies_text
    from taction.verification.report.views.verdict_view import CHANGES

    lines = remedies_text(found.verdict.scene, found.remedies).splitlines()
    rest = 0 if whole else max(len(lines) - CHANGES, 0)
    return [*lines[: len(lines) - rest], *[f"  and {rest} more: -v"] * bool(rest)]


DIALECTS = ("ngspice", "ltspice", "hspice", "xyce", "spectre")  # --help does not load the table


def _verified_document(found: Verified) -> object:
    if found.remedies is None:
        return found.document
    return found.document | {"what_to_change": found.remedies}


def _write_report(found: Verified, path: str) -> None:
    from taction.verification.report.renderers.page import write_page
    from taction.verification.report.views.verdict_view import view

    write_page(view(found.verdict, changes="\n".join(change_lines(found, whole=True))), path)


def _annotate(documents: Iterable[Mapping[str, Any]], call: Call) -> None:
    """Print errors and warnings as GitHub shows them at the files."""
    if call.options["annotate"]:
        from taction.verification.report.junit import annotation_lines

        tell(annotation_lines(documents))


def _annotate_error(error: taction.TactionError, call: Call) -> None:
    from taction.system.documents import error_document, plain

    _annotate([{"file": call.options["scenes"][0], **plain(error_document(error))}], call)


def _several(options: Mapping[str, Any]) -> Job | None:
    """Return the job of several scenes, or that of --solve; None for one scene."""
    scenes = options["scenes"]
    alone = len(scenes) == 1 and not Path(scenes[0]).is_dir() and not options["exclude"]
    if options["solution"]:
        if not alone:
            raise click.UsageError("--solve is for one scene")
        source = click.get_current_context().get_parameter_source("engine")
        if source is not ParameterSource.DEFAULT:
            raise click.UsageError("--solve simulates no board: leave out --engine")
        return SOLUTION
    if alone and options["junit"] is None:
        return None
    if options["settings"]:
        raise click.UsageError("--set is for one scene: several may have different keys")
    return VERIFY_FILES


JUNIT = text_file("junit", "Write a JUnit XML report.", "verification.report.junit:files_junit")
VERIFY_FILES = Job(
    function="verify_files",
    document=f"{DOCUMENTS}.plain:VerifyFilesDocument",
    outputs=(JUNIT,),
    schema="verify-files",
    after=lambda found, call: _annotate(found.documents, call),
    lacks="shows one board; give one scene file, without --exclude and --junit",
)


def _of_the_scene(call: Call) -> None:
    from taction.netlist_gen.scene.axes import with_settings
    from taction.netlist_gen.scene.loading import load_scene

    scene, settings = call.options["scenes"][0], call.options["settings"]
    call.arguments["scene"] = with_settings(load_scene(scene), settings) if settings else scene


SOLUTION = Job(
    function="solve",
    schema="solve",
    before=_of_the_scene,
    lacks="shows a verdict; --solve has none",
)
VERIFY = Command(
    work=verify_scene,
    document=_verified_document,
    text=_print_changes,
    outputs=(
        replace(
            picture("outputs, settling band and recovered stress"),
            write=lambda found, path: found.verdict.plot(path),
        ),
        replace(REPORT, write=_write_report),
    ),
    after=lambda found, call: _annotate([found.document], call),
    failed=_annotate_error,
    other=_several,
    python_only=("scene",),
    parameters=(
        argument("scenes", metavar="SCENE...", nargs=-1, required=True),
        option("margins", is_flag=True, of="verify_files"),
        option(
            "solution",
            "--solve",
            is_flag=True,
            help="Print the numerical solution with its certificate, without any circuit.",
        ),
        option("exclude", multiple=True, metavar="PATTERN", of="verify_files"),
        JUNIT,
        ANNOTATE,
        replace(OPTIONS["jobs"], of="verify_files"),
        option("changes", type=NumberRange(0), metavar="DESIGNS", of="what_to_change"),
        option("any_part", is_flag=True, of="what_to_change"),
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


def _netlist_remarks(found: Any, call: Call) -> None:
    if call.options["explain"]:
        click.echo(f"{visible(found.circuit.name)}: left out, not needed by the scene:", err=True)
        for item in found.circuit.omissions:
            click.echo(f"  {item.what}: {item.why}", err=True)
        if found.pruning is not None:
            click.echo(f"pruning: {found.pruning.text}", err=True)
    for warning in found.warnings:
        click.echo(f"warning: {visible(warning)}", err=True)


def _nothing(found: Any) -> None:
    """Print nothing: the files are the result."""


def _announce(call: Call) -> None:
    """Say the address of the page as soon as it can be opened."""

    def announce(address: str) -> None:
        if call.as_json:
            print_json({"address": address})
        else:
            click.echo(address)
        say("Ctrl-C ends the explorer")

    call.arguments["announce"] = announce


def _output(text: str) -> CommandParameter:
    return replace(OUTPUT, attributes={**OUTPUT.attributes, "help": text})


DIFF = Command(
    outputs=(picture("the outputs of both over each other"), REPORT),
    parameters=(argument("first", metavar="A"), argument("second", metavar="B")),
    ends="Exit status: 0 if all readings are equal within their uncertainties, 1 if one is not, 3"
    " if that is unknown.",
)
NETLIST = Command(
    text=lambda found: None if found.written else sys.stdout.write(found.text),
    after=_netlist_remarks,
    files=lambda found, call: found.written,
    parameters=(
        _output("Deck file; by default stdout."),
        option("dialect", type=click.Choice(DIALECTS), show_default=True),
    ),
)
BOM = Command(files=own_file)
KICAD = Command(
    text=_nothing,
    after=lambda found, call: tell(f"not drawn: {what}" for what in found.not_drawn),
    files=lambda found, call: found.written,
    parameters=(folder("output", "-o"),),
)
BUILD = Command(
    files=lambda found, call: [found.folder],
    parameters=(folder("output", "-o"),),
    ends="Exit status: that of the verdict.",
)
SOLVE = Command(
    schema="solve",
    ends="Exit status: 3 if the solution has no certificate.",
)
SIMULATE = Command(
    files=own_file,
    parameters=(replace(OUTPUT, check="verification.report.output_checks:check_export"),),
)
EXPLORE = Command(
    document=lambda found: iter(()),
    text=_nothing,
    before=_announce,
    after=lambda found, call: say("ended"),
    parameters=(option("port", type=click.IntRange(0, 65535)),),
)


def _new_file(call: Call) -> None:
    """Take the file from FILE or -o; by default the function knows its name."""
    from taction.system.errors import Complaint, InputError

    file, output = call.options["file"], call.options["output"]
    if file is not None and output is not None:
        raise InputError("-o", Complaint("FILE", repr(output), "give FILE or -o, not both"))
    call.arguments["file"] = file or output
    if call.arguments["file"] is None:
        del call.arguments["file"]


def _new_files(found: NewScene, call: Call) -> list[str]:
    if found.fresh is not None:
        return list(found.written)
    return [f"{found.file}; `taction verify {found.file}` verifies it"]


def _rescaled(call: Call) -> None:
    """Take the file as for a new scene, and the op-amp of the scene where none is asked for."""
    from taction.netlist_gen.scene.open_tables import refuse_unknown
    from taction.verification.design.fresh_scene import refuse_existing

    _new_file(call)
    file = call.arguments.pop("file", "scene.toml")
    refuse_existing(Path(file), force=call.options["force"])
    call.arguments["output"] = file
    if click.get_current_context().get_parameter_source("opamp") is ParameterSource.DEFAULT:
        del call.arguments["opamp"]
    else:
        refuse_unknown(call.arguments["opamp"], "--opamp")


NEW_MATRIX = Job(function="new", schema="new-matrix", before=_new_file, files=_new_files)
NEW_SCALED = Job(
    function="scale",
    schema="scale",
    before=_rescaled,
    files=lambda found, call: [call.arguments["output"]],
)
NEW_SCHEMA = Job(
    function="scene_schema", document=dict, text=lambda found: print_json(found, ""), schema=None
)


def _new_job(options: Mapping[str, Any]) -> Job | None:
    if options["schema"]:
        return NEW_SCHEMA
    if options["scene"] is not None:
        for name in ("matrix", "strain", "noise", "lambda", "prune"):
            if options["lam" if name == "lambda" else name] is not None:
                raise click.UsageError(f"--from has the problem of its scene; leave out --{name}")
        return NEW_SCALED
    if click.get_current_context().get_parameter_source("share") is not ParameterSource.DEFAULT:
        raise click.UsageError("--share needs --from")
    return None if options["matrix"] is None else NEW_MATRIX


NEW = Command(
    document=lambda found: {"file": found.file},
    text=_nothing,
    before=_new_file,
    files=_new_files,
    other=_new_job,
    parameters=(
        argument("file", metavar="[FILE]", type=FILE, required=False, reads=False, writes=True),
        _output("The same as FILE."),
        option("schema", is_flag=True, help="Print the JSON schema of scene files instead."),
        option(
            "scene",
            "--from",
            metavar="SCENE",
            reads=True,
            help="A scene for the problem of SCENE, with G0, U0, s and R that use the swing of its"
            " op-amps and that can be bought; lambda stays. The state-space engine verifies it.",
        ),
        OPTIONS["share"],
        option("noise", metavar="SIGMA"),
        option("lam", "--lambda", type=NumberRange(0, min_open=True)),
        option("prune", type=NumberRange(0, 1, max_open=True)),
    ),
)
MODELS = Command(
    view="verification.report.views.opamp_view:list_view",
    commands={
        "show": Command(
            function="opamp",
            outputs=(picture("the Bode diagram of the open loop"),),
            parameters=(argument("name", type=str, reads=False),),
        ),
        "import": Command(
            function="import_model",
            files=lambda found, call: [found.file],
            parameters=(
                option("pins", metavar="ROLE,ROLE,..."),
                option("supply", show_default=True),
                option("compensation", metavar="FARADS"),
            ),
        ),
    },
)
DOCTOR = Command(ends="Exit status: 3 if ngspice is missing.")
MCP = Command(
    document=lambda found: iter(()),
    text=_nothing,
    schema=None,
    parameters=(option("limit", metavar="SECONDS", type=NumberRange(0, 86400, min_open=True)),),
)
