"""The parts that commands share: ``--json``, common options, the console and exit statuses."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console

    from taction.netlist_gen.scene.axes import Axis
    from taction.netlist_gen.scene.scene import Scene
    from taction.verification.report.html.blocks import Report

STATUS = {"pass": 0, "fail": 1, "bad input": 2, "inconclusive": 3}
ENGINES = ("auto", "ngspice", "statespace")
GRID_ENGINES = ("both", "hybrid")
# parameters of commands that are read
INPUTS = ("scene", "scenes", "folder", "baseline", "file", "matrix", "strain")
OUTPUTS = {  # parameters of commands that are files or folders to write, and their options
    "output": "-o",
    "target": "FILE",
    "store": "--store",
    "plot": "--plot",
    "report": "--report",
    "export_file": "--export",
    "junit": "--junit",
    "markdown": "--markdown",
    "page": "--page",
}


class EngineChoice(click.Choice[str]):
    """An engine; those that need a grid of points are refused with the command that has one."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the engine, or fail with the known engines."""
        if value in GRID_ENGINES and value not in self.choices:
            text = f"{value!r} runs two engines over a grid of points, for `taction sweep` only"
            self.fail(f"{text}; expected one of {', '.join(map(repr, self.choices))}", param, ctx)
        return super().convert(value, param, ctx)


ENGINE = click.option(
    "--engine", type=EngineChoice(ENGINES), help="Engine in the place of the scene's own."
)
JOBS = click.option(
    "--jobs", type=click.IntRange(1, 4096), help="Number of processes; by default one per core."
)
CLUSTER = click.option(
    "--cluster", metavar="tcp://HOST:PORT", help="Address of a Dask scheduler that runs the points."
)


def output_option(text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option ``-o``, a file; `text` is its help."""
    return click.option("-o", "--output", type=click.Path(dir_okay=False), help=text)


def plot_option(content: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option ``--plot``, which draws `content` into a file."""
    text = f"Draw {content} into FILE (PNG, SVG or PDF)."
    return click.option("--plot", type=click.Path(dir_okay=False), metavar="FILE", help=text)


def report_option() -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option ``--report``, one HTML file with pictures."""
    text = "Write a report with pictures into FILE (HTML, one file that needs no network)."
    return click.option("--report", type=click.Path(dir_okay=False), metavar="FILE", help=text)


def check_report(report: str | None) -> None:
    """Refuse a ``--report`` file that cannot be written, before any work is done."""
    if report is not None:
        from taction.verification.report.html.file import check_report_file

        check_report_file(report)


def save_report(report: str | None, make: Callable[[], Report]) -> None:
    """Write the report that `make` returns, if there is a file for it."""
    if report is not None:
        from taction.verification.report.html.file import write_report

        write_report(make(), report)
        click.echo(f"wrote {report}", err=True)


def check_plot(plot: str | None) -> None:
    """Refuse a ``--plot`` file that cannot be drawn, before any work is done."""
    if plot is not None:
        from taction.verification.report.picture import check_plot_file

        check_plot_file(plot)


def command(function: Callable[..., None]) -> click.Command:
    """Return `function` as a command with the option ``--json``."""
    text = "Print one JSON document on stdout and everything else on stderr."
    made = click.command()(_with_separate_files(function))
    made.params.append(click.Option(["--json", "as_json"], is_flag=True, help=text))
    return made


def _with_separate_files(function: Callable[..., None]) -> Callable[..., None]:
    """Refuse an output that cannot be written, is an input, or another output, before any work."""

    @functools.wraps(function)
    def checked(*args: Any, **kwargs: Any) -> None:
        outputs = {OUTPUTS[key]: file for key, file in kwargs.items() if key in OUTPUTS and file}
        if outputs:
            from taction.verification.report.output_checks import check_folder, check_separate

            check_separate(_inputs(kwargs), outputs)
            for key, file in kwargs.items():
                if key in OUTPUTS and file and key not in _folders():
                    check_folder(file, OUTPUTS[key])
        function(*args, **kwargs)

    return checked


def _folders() -> set[str | None]:
    """Return the parameters of the command that are folders."""
    parameters = click.get_current_context().command.params
    return {p.name for p in parameters if isinstance(p.type, click.Path) and not p.type.file_okay}


def _inputs(arguments: Mapping[str, Any]) -> Iterator[str | None]:
    for name in INPUTS:
        value = arguments.get(name)
        yield from value if isinstance(value, tuple) else (value,)


def scene_command(function: Callable[..., None]) -> click.Command:
    """Return `function` as a `command` with the argument SCENE, the path of a scene file."""
    made = command(_with_questions(function))
    made.params.insert(0, click.Argument(["scene"], type=click.Path()))
    return made


def _with_questions(function: Callable[..., None]) -> Callable[..., None]:
    """Ask on stderr what may be a slip in the scene; the command reports its mistakes."""

    @functools.wraps(function)
    def asked(scene: str, *args: Any, **kwargs: Any) -> None:
        from taction.netlist_gen.scene.file import load_scene
        from taction.netlist_gen.scene.questions import questions
        from taction.system.errors import InputError

        with suppress(InputError):
            for question in questions(load_scene(scene)):
                say(f"question: {question}")
        function(scene, *args, **kwargs)

    return asked


def ask_axes(scene: Scene, groups: Sequence[Sequence[Axis]]) -> None:
    """Ask on stderr what may be a slip in the axes of a study."""
    from taction.netlist_gen.scene.axis_questions import axis_questions

    for question in axis_questions(scene, groups):
        say(f"question: {question}")


def say(text: str) -> None:
    """Print a line of text on stderr, below the command's name."""
    click.echo(f"taction: {text}", err=True)


def print_json(document: Mapping[str, Any], schema: str | None = None) -> None:
    """Print one JSON document on stdout; NaN and infinities become null.

    Its field `taction` says what made it. `schema` is the name of its schema, by default that of
    the command; an empty name leaves the document as it is.
    """
    import json

    context = click.get_current_context(silent=True)
    path = context.command_path.split()[1:] if context else []  # without the name of the program
    name = "-".join(path) if schema is None else schema
    if name:
        from taction.verification.report.schemas.head import document_head

        document = document_head(name, document) | dict(document)
    click.echo(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Return `value` in the types of JSON: arrays as lists, NaN and infinities as None."""
    import enum
    import math

    from taction.system.file_names import printable

    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, dict):
        return {plain(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return value


def console(*, stderr: bool = False) -> Console:
    """Return the console that reports print on."""
    from taction.verification.report.page import Page

    return Page(stderr=stderr)


@contextmanager
def stage_display(*, every: bool = False) -> Iterator[Callable[[str], None]]:
    """Show the stage on stderr; without a terminal long simulations, or `every` one, and a few."""
    if not sys.stderr.isatty():
        from taction.cli.sparse_lines import SparseLines

        shown: set[str] = set()
        lines = SparseLines(say)

        def announce(stage: str) -> None:
            if every or stage.startswith("simulation (about"):
                if stage not in shown:
                    shown.add(stage)
                    say(stage)
            else:
                lines.stage(stage)

        yield announce
        return
    with console(stderr=True).status("starting") as status:
        yield lambda stage: status.update(stage)


def write_all(texts: Mapping[str, Callable[[], str]]) -> bool:
    """Write all files, also after an error; return whether every file was written."""
    from taction.system.atomic_files import write_atomically
    from taction.system.errors import InputError

    complete = True
    for path, text in texts.items():
        try:
            write_atomically(path, text())
            click.echo(f"wrote {path}", err=True)
        except InputError as error:
            click.echo(f"taction: {error}", err=True)
            complete = False
    return complete
