"""The commands that verify many boards, or search for one: a table of public functions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from taction.cli.command import (
    ANNOTATE,
    DATABASE,
    FILE,
    REPORT,
    Call,
    Command,
    Job,
    NumberRange,
    argument,
    folder,
    option,
    output,
    own_file,
    picture,
    text_file,
)
from taction.cli.printing import tell

if TYPE_CHECKING:
    from taction.verification.studies.regression.regress import RegressionReport

JUNIT = "verification.report.junit"


SAMPLE = Job(
    function="verify_sample",
    outputs=(REPORT,),
    schema="montecarlo-sample",
    lacks="shows many samples; leave out --sample",
)
MONTECARLO = Command(
    outputs=(picture("histograms with limits, and the components behind the spread,"), REPORT),
    other=lambda options: None if options["sample"] is None else SAMPLE,
    parameters=(
        option("sample", type=click.IntRange(0), of="verify_sample", required=False),
        option("min_yield", type=NumberRange(0, 1)),
        DATABASE,
    ),
    ends="Exit status with --min-yield: 0 if the whole 95 % interval of the yield lies above that"
    " value, 1 if it lies below, else 3. Without --min-yield: 0.",
)


CORNERS = Command(
    outputs=(REPORT,),
    parameters=(option("corner", multiple=True, metavar="KEY=Z,..."),),
    ends="Exit status: 1 if a corner fails, else 3 if a corner has no verdict.",
)


TUNE = Command(
    outputs=(picture("settling time against overshoot"), REPORT),
    files=own_file,
    parameters=(
        option("reach", type=NumberRange(1, 1000, min_open=True)),
        option("overshoot", type=NumberRange(0, min_open=True)),
    ),
)


def _choice_database(call: Call) -> None:
    """Name the database after the scene."""
    given = call.arguments
    given["store"] = given["store"] or f"{given['scene'].name}-choose.sqlite"


CHOOSE = Command(
    outputs=(picture("maps of C and gain for every op-amp"), REPORT),
    before=_choice_database,
    files=lambda found, call: [one.file for one in found.best if one.file],
    parameters=(
        option("settling", metavar="TIME"),
        option("rise", metavar="TIME"),
        option("overshoot", metavar="SHARE"),
        option("noise", metavar="VOLTS"),
        option("opamps", metavar="A,B,C"),
        option("c_range", metavar="LOW:HIGH"),
        option("gain_range", metavar="LOW:HIGH"),
        replace(folder("output", "-o"), check="system.output_files:check_own_folder"),
        replace(DATABASE, name="store", flags=("--store",)),
    ),
    ends="Exit status: 0 if a design passes on both engines, 1 if none passes.",
)
SCALE = Command(files=own_file)
ONSET = Command(
    outputs=(picture("the pole map and the root locus"), REPORT),
    parameters=(
        option("over", metavar="KEY[=LOW:HIGH:N]"),
        option("transients", "--confirm/--no-confirm"),
    ),
    ends="Exit status: 0 if the question was answered, 3 if a transient contradicts a crossing.",
)


CHECK = Command(
    outputs=(picture("step response and poles"), REPORT),
    files=own_file,
    parameters=(
        option("outputs", "--output", metavar="NODE", multiple=True),
        option("over", metavar="NAME[=LOW:HIGH:N]", multiple=True),
        option("checks", "--check", metavar="NAME=LIMIT", multiple=True),
        option("expect", metavar="V(NODE)=VALUE", multiple=True),
        option("unit", metavar="VOLTS"),
        option("accept", metavar="SHARE"),
        option("tolerances", metavar="FILE", type=FILE, reads=True),
        option("output", "-o", type=FILE, writes=True),
    ),
    ends="Exit status: 0 without checks or if all pass, 1 a check failed, 3 one is not decided.",
)


def _check_sweep(call: Call) -> None:
    """Refuse axes that cannot be drawn, and name the database after the scene's file."""
    given = call.arguments
    if call.options["plot"] is not None:
        from taction.verification.report.views.sweep_view import check_axes

        check_axes(len(given["over"]), call.options["plot"])
    given["output"] = given["output"] or f"{given['scene'].file.stem}.sqlite"


SWEEP = Command(
    document="verification.report.documents.document_catalogue:sweep_pieces",
    outputs=(
        output(
            "export",
            "Write a table (.csv, .parquet) or grid (.nc).",
            "verification.studies.sweep.result:export_sweep",
            check="verification.studies.sweep.result:check_sweep_export",
        ),
        picture("maps over two axes, or curves over one axis,"),
        REPORT,
    ),
    before=_check_sweep,
    parameters=(
        option("over", multiple=True, metavar="KEY=LOW:HIGH:N"),
        option("fix", multiple=True, metavar="KEY[=VALUE]"),
        DATABASE,
    ),
    ends="Exit status: 0 if every point is stored, whatever its outcome; with --strict 1 if a point"
    " fails; 3 if no point has a verdict.",
)


def _regression_markdown(found: RegressionReport) -> str:
    from taction.verification.report.renderers.terminal import markdown

    return markdown(found.page(), "taction regress")


def _annotate_scenes(found: RegressionReport, call: Call) -> None:
    """Print errors and warnings as GitHub shows them at the files."""
    if call.options["annotate"]:
        from taction.verification.report.junit import regression_annotations

        tell(regression_annotations(found))


REGRESS = Command(
    after=_annotate_scenes,
    outputs=(
        text_file("junit", "Write a JUnit XML report.", f"{JUNIT}:regression_junit"),
        text_file("markdown", "Write a Markdown summary.", _regression_markdown),
        REPORT,
    ),
    files=lambda found, call: [call.options["baseline"]] if found.updated else [],
    parameters=(
        argument("folder", metavar="DIR"),
        option("baseline", type=click.Path(), metavar="FILE", reads=True),
        ANNOTATE,
    ),
    ends="Exit status: 1 if a check failed, or if a result differs from the baseline by more than"
    " the scene's table [regression] allows. --update stores differences, but"
    " leaves a scene with a failed check as it was.",
)
STRESS = Command(
    outputs=(REPORT,),
    ends="Exit status: 1 if an outcome or a number is wrong, 3 if ngspice is missing.",
)


ACCURACY = Command(
    outputs=(picture("error against run time"), REPORT),
    parameters=(option("budget", type=NumberRange(min=0.5)),),
    ends="Exit status: 3 if no run of the board ended within the budget.",
)


REPRODUCE = Command(
    outputs=(REPORT,),
    ends="Exit status: 1 if a verdict differs from the verdict that taction has on record, 3 if a"
    " claim could not be tested.",
)
DEMO = Command(
    outputs=(picture("the outputs of the three boards"),),
    files=lambda found, call: [found.file] if found.file else [],
    ends="Exit status: 0 if the boards behave as told.",
)
