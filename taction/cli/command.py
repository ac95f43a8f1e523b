"""What a command is: a public function, its options, and what shows the result.

The arguments and options are those of the function. A parameter by place is an argument, one by
keyword an option; a default True or False makes a flag. Their sentences are the first paragraph of
each parameter in its docstring; a second paragraph is for Python alone. What an option has besides,
such as a range, stands in `OPTIONS`, or in the entry of the command.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import click

import taction
from taction.cli.printing import StageLine
from taction.system import results
from taction.system.errors import Complaint, InputError

ENGINES = ("auto", "ngspice", "statespace")

Target = str | Callable[..., Any]
"""A function, or its place below `taction`: "verification.report.views.board_view:view"."""


def load(target: Target) -> Callable[..., Any]:
    """Return a function, imported now if `target` is its place."""
    return target if callable(target) else results.load(f"taction.{target}")


@dataclass(frozen=True, slots=True, eq=False)
class CommandParameter:
    """An argument (without flags) or an option of a command."""

    name: str  # keyword of the function, or of what shows the result
    flags: tuple[str, ...] = ()  # ``("-n", "--samples")``; empty for an argument
    # What click needs beside default and help: type, metavar, is_flag ...
    attributes: Mapping[str, Any] = field(default_factory=dict)
    of: str = ""  # the function whose keyword it is, if this is not the command's own function
    # `reads`, `writes`: whether it is a file or a folder that the command reads or writes.
    reads: bool = False
    writes: bool = False
    check: Target | None = None  # takes the value and refuses it, before any work is done
    write: Target | None = None  # takes the result and the path, and writes what shows the result
    verb: str = "wrote"  # what is said of that file

    def made(self, function: str) -> click.Parameter:
        """Return the parameter of click; default and help are those of the function."""
        attributes = dict(self.attributes)
        if not self.flags:
            return click.Argument([self.name], **attributes)
        known = signature(self.of or function).get(self.name)
        if known is not None:
            if known.default is inspect.Parameter.empty:
                attributes.setdefault("required", True)
            elif known.default not in (None, (), ""):
                attributes.setdefault("default", known.default)
            attributes.setdefault("help", sentences(self.of or function).get(self.name))
        return click.Option([*self.flags, self.name], **attributes)

    @property
    def option(self) -> str:
        """What a message calls it: its first flag, or ``FILE``."""
        return self.flags[0] if self.flags else "FILE"

    @property
    def is_folder(self) -> bool:
        """Whether it names a folder."""
        kind = self.attributes.get("type")
        return isinstance(kind, click.Path) and not kind.file_okay


OWN = ("of", "reads", "writes", "check", "write", "verb")
FILE = click.Path(dir_okay=False)


def option(name: str, *flags: str, **attributes: Any) -> CommandParameter:
    """Return an option; keywords in `OWN` are those of `CommandParameter`, others of click."""
    own = {key: attributes.pop(key) for key in OWN if key in attributes}
    return CommandParameter(name, flags or (f"--{name.replace('_', '-')}",), attributes, **own)


def argument(name: str, *, reads: bool = True, **attributes: Any) -> CommandParameter:
    """Return an argument, a file or a folder that is read if `reads` is not False."""
    writes = attributes.pop("writes", False)
    kind = {"type": click.Path(), **attributes}
    return CommandParameter(name, (), kind, reads=reads, writes=writes)


def output(name: str, text: str, write: Target, **more: Any) -> CommandParameter:
    """Return the option of a file that shows the result."""
    return option(name, type=FILE, metavar="FILE", help=text, writes=True, write=write, **more)


def picture(content: str) -> CommandParameter:
    """Return the option ``--plot`` of a result with a picture."""
    text = f"Draw {content} into FILE (PNG, SVG or PDF)."
    check = "system.results:check_plot_file"
    return output("plot", text, lambda found, path: found.plot(path), check=check, verb="drew")


REPORT = output(
    "report",
    "Write a report with pictures into FILE (HTML, one file that needs no network).",
    lambda found, path: found.report(path),
    check="verification.report.output_checks:check_report_file",
)


def text_file(name: str, text: str, make: Target) -> CommandParameter:
    """Return the option ``--NAME``; `make` takes the result and returns the file's text."""

    def write(result: Any, path: str) -> None:
        from taction.system.output_files import write_atomically

        write_atomically(path, load(make)(result))

    return output(name, text, write)


@dataclass(slots=True)
class Call:
    """A command line that is running."""

    arguments: dict[str, Any]  # of the function
    options: dict[str, Any]  # all options and arguments of the command by name

    @property
    def as_json(self) -> bool:
        """Whether stdout gets one document."""
        return bool(self.options["as_json"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A public function, and what shows its result."""

    function: str  # its name in `taction`
    # Takes the result and returns its document, or an iterator of the parts of a long one; by
    # default the result is its own.
    document: Target = lambda found: found
    # Takes the result and returns the page that is printed; by default its own.
    view: Target = lambda found: found.page()
    text: Target | None = None  # takes the result and prints it, in the place of its page
    outputs: tuple[CommandParameter, ...] = ()  # the files that show the result
    # Takes the `Call` and the progress, and returns the result in the place of the function.
    work: Callable[[Call, StageLine], Any] | None = None
    # Of the document; by default the name of the command, None for a document without a head.
    schema: str | None = ""
    # Takes the `Call` before any work: questions and checks of its own.
    before: Callable[[Call], None] | None = None
    # Takes the result and the `Call` after the work: what is said on stderr.
    after: Callable[[Any, Call], object] | None = None
    # Takes a `TactionError` and the `Call`.
    failed: Callable[[taction.TactionError, Call], None] | None = None
    # Takes the result and the `Call`, and returns the names of the files that are written.
    files: Callable[[Any, Call], Iterable[str]] = lambda found, call: ()
    lacks: str = ""  # why an output of the command's other job is refused


@dataclass(frozen=True, slots=True, kw_only=True)
class Command(Job):
    """An entry of the table of commands: a job with its options."""

    # Those that are not as the function's signature and `OPTIONS` have them, or not of it.
    parameters: tuple[CommandParameter, ...] = ()
    python_only: tuple[str, ...] = ()  # parameters of the function that are no options
    ends: str = ""  # what the exit status means, where it is not as usual
    # Takes the options and returns another job for some of them.
    other: Callable[[Mapping[str, Any]], Job | None] | None = None
    commands: Mapping[str, Command] = field(default_factory=dict)  # below it

    @property
    def every(self) -> tuple[CommandParameter, ...]:
        """All arguments and options, with those of the outputs."""
        given = {parameter.name: parameter for parameter in self.parameters}
        own = [
            given.pop(name) if name in given else OPTIONS.get(name) or _derived(known)
            for name, known in signature(self.function).items()
            if name not in (*PYTHON_ONLY, *self.python_only)
        ]
        return (*own, *given.values(), *self.outputs)


@cache
def signature(function: str) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a public function."""
    return inspect.signature(getattr(taction, function)).parameters


def _derived(known: inspect.Parameter) -> CommandParameter:
    """Return the argument or the option of a parameter of a function."""
    if known.kind is not inspect.Parameter.KEYWORD_ONLY:
        return argument(known.name)
    flag = known.name.replace("_", "-")
    if known.default is True:
        return option(known.name, f"--{flag}/--no-{flag}")
    return option(known.name, **({"is_flag": True} if known.default is False else {}))


@cache
def sentences(function: str) -> dict[str, str]:
    """Return the first paragraph of each parameter in the docstring of a public function."""
    text = inspect.getdoc(getattr(taction, function)) or ""
    part = re.search(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", text, re.DOTALL | re.MULTILINE)
    found = re.split(r"^(\w+(?:, \w+)*) : .*\n", part[1] if part else "", flags=re.MULTILINE)
    said = dict[str, str]()
    for names, paragraphs in zip(found[1::2], found[2::2], strict=True):
        first = inspect.cleandoc(paragraphs).partition("\n\n")[0]
        sentence = " ".join(re.sub(r'``"?(.*?)"?``', r"\1", first).split())
        said |= dict.fromkeys(names.split(", "), sentence)
    return said


def beginning(function: str) -> str:
    """Return the docstring of a public function up to its first section."""
    text = inspect.getdoc(getattr(taction, function)) or ""
    head = re.split(r"^\w+\n-+\n", text, maxsplit=1, flags=re.MULTILINE)[0]
    return re.sub(r"``(.*?)``", r"\1", head).strip()


class EngineChoice(click.Choice[str]):
    """The engines of taction; the scene knows those of other packages, and refuses any other."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name as it is."""
        return value


def refuse_withdrawn(engine: str) -> None:
    """Refuse an engine that is no more; the scene refuses one that is unknown."""
    if engine in ("both", "hybrid"):
        text = "it was withdrawn: --engine ngspice compares every point with state space"
        raise InputError("--engine", Complaint("NAME", repr(engine), text))


class NumberRange(click.FloatRange):
    """A number of an option as scenes have them, finite: ``nan`` passes every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number, or fail with the numbers that are accepted."""
        from taction.system.quantities import number

        try:
            finite = math.isfinite(number(str(value)))
        except ValueError:
            finite = False
        if not finite:
            self.fail(f"{value!r} is not a valid float range.", param, ctx)
        return super().convert(value, param, ctx)


ANNOTATE = option(
    "annotate",
    "--annotate/--no-annotate",
    envvar="GITHUB_ACTIONS",
    default=False,
    help="Print errors and warnings on stderr as GitHub shows them at the files; by default"
    " where GITHUB_ACTIONS is set.",
)
OUTPUT = option("output", "-o", "--output", type=FILE, writes=True)
DATABASE = replace(OUTPUT, check="verification.studies.running.store:check_database")
PYTHON_ONLY = ("progress", "strains", "announce")
"""Parameters of functions that are no options."""
OPTIONS = {
    each.name: each
    for each in (
        option("engine", type=EngineChoice(ENGINES), check=refuse_withdrawn),
        option("jobs", type=click.IntRange(1, 4096)),
        option(
            "cluster",
            metavar="tcp://HOST:PORT",
            check="verification.studies.running.cluster:check_address",
        ),
        OUTPUT,
        option("settings", "--set", multiple=True, metavar="KEY=VALUE"),
        option("samples", "-n", "--samples", type=click.IntRange(1, 10_000_000)),
        option("seed", type=click.IntRange(0)),
        option("points", type=click.IntRange(1, 101)),
        option("margin", metavar="FACTOR", type=NumberRange(1, 100)),
        option("share", type=NumberRange(0, 0.9, min_open=True), of="scale"),
        option("lam", "--lambda", type=NumberRange(0)),
        option("matrix", metavar="T", reads=True),
        option("strain", metavar="EPS", reads=True),
        option("supply", metavar="VOLTS"),
        option("opamp", metavar="NAME"),
        option("agree", metavar="SHARE", type=NumberRange(0, 1, min_open=True)),
        option("only", multiple=True, metavar="NAME"),
    )
}
"""What options have beside their names, defaults and sentences, in every command that has them."""


def folder(name: str, *flags: str, **attributes: Any) -> CommandParameter:
    """Return an option that names a folder to write."""
    kind = {"metavar": "FOLDER", "type": click.Path(file_okay=False)}
    return CommandParameter(name, flags, kind | attributes, writes=True)


def own_file(found: Any, call: Call) -> list[str]:
    """Return the file of ``-o``, which the function has written."""
    return [] if call.options["output"] is None else [call.options["output"]]
