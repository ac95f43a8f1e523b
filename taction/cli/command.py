"""What a command is: a public function, its options, what shows the result, and one way to run it.

The arguments and options are those of the function. A parameter by place is an argument, one by
keyword an option; a default True or False makes a flag. Their sentences are the first paragraph of
each parameter in its docstring; a second paragraph is for Python alone. What an option has besides,
such as a range, stands in `OPTIONS`, or in the entry of the command.
"""

from __future__ import annotations

import errno
import inspect
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import click

import taction
from taction.cli.printing import STATUS, StageLine, console, display, print_json, say, tell
from taction.system import results
from taction.system.errors import INTERRUPTED, Complaint, InputError, Interrupted
from taction.system.foreign_files import visible
from taction.system.output_files import ENDINGS, check_file, check_folder, write_atomically
from taction.system.progress import attempt

ENGINES = ("auto", "ngspice", "statespace")
DIALECTS = ("ngspice", "ltspice", "hspice", "xyce", "spectre")  # --help does not load the table

Options = dict[str, Any]
"""The arguments and options of a command line by name."""
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
    write: Target | None = None  # takes the result and the path, and writes what shows the result

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


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a stream that takes no more
OWN = ("of", "reads", "writes", "write")
FILE = click.Path(dir_okay=False)


def option(name: str, *flags: str, **attributes: Any) -> CommandParameter:
    """Return an option; keywords in `OWN` are those of `CommandParameter`, others of click."""
    own = {key: attributes.pop(key) for key in OWN if key in attributes}
    return CommandParameter(name, flags or (f"--{name.replace('_', '-')}",), attributes, **own)


def argument(name: str, *, reads: bool = True, **attributes: Any) -> CommandParameter:
    """Return an argument, a file or a folder that is read if `reads` is not False."""
    return replace(option(name, **{"type": click.Path(), **attributes}), flags=(), reads=reads)


def output(name: str, text: str, write: Target) -> CommandParameter:
    """Return the option of a file that shows the result."""
    return option(name, type=FILE, metavar="FILE", help=text, writes=True, write=write)


def picture(content: str) -> CommandParameter:
    """Return the option ``--plot`` of a result with a picture."""
    text = f"Draw {content} into FILE (PNG, SVG or PDF)."
    return output("plot", text, lambda found, path: found.plot(path))


REPORT = output(
    "report",
    "Write a report with pictures into FILE (HTML, one file that needs no network).",
    lambda found, path: found.report(path),
)


def text_file(name: str, text: str, make: Target) -> CommandParameter:
    """Return the option ``--NAME``; `make` takes the result and returns the file's text."""
    return output(name, text, lambda found, path: write_atomically(path, load(make)(found)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A public function with its options, and what shows its result; None shows nothing."""

    function: str = ""  # its name in `taction`; by default that of the command
    # Takes the result and returns the page that is printed; by default its own.
    view: Target = lambda found: found.page()
    text: Target | None = None  # takes the result and prints it, in the place of its page
    outputs: tuple[CommandParameter, ...] = ()  # the files that show the result
    # Takes the options and the progress, and returns the result in the place of the function.
    work: Callable[[Options, StageLine], Any] | None = None
    schema: str = ""  # of the document; by default the name of the command
    # Takes the options before any work: checks and defaults of its own.
    before: Callable[[Options], None] | None = None
    # Takes the result after the work: what is said on stderr.
    after: Callable[[Any], object] | None = None
    # Takes the result and the options, and returns the names of the files that are written.
    files: Callable[[Any, Options], Iterable[str]] = lambda found, options: ()
    lacks: str = ""  # why an output of the command's other job is refused
    about: str = ""  # its line in the list of commands
    # Those that are not as the function's signature and `OPTIONS` have them, or not of it.
    parameters: tuple[CommandParameter, ...] = ()
    python_only: tuple[str, ...] = ()  # parameters of the function that are no options
    ends: str = ""  # what the exit status means, where it is not as usual
    # Takes the options and returns another job for some of them.
    other: Callable[[Options], Command | None] = lambda options: None
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
        """Return the name as it is; refuse an engine that is no more."""
        if value in ("both", "hybrid"):
            text = "it was withdrawn: --engine ngspice compares every point with state space"
            raise InputError("--engine", Complaint("NAME", repr(value), text))
        return value


class NumberRange(click.FloatRange):
    """A number of an option as scenes have them, finite: ``nan`` passes every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number, or fail with the numbers that are accepted."""
        from taction.system.quantities import number

        with suppress(ValueError):
            if math.isfinite(number(str(value))):
                return super().convert(value, param, ctx)
        self.fail(f"{value!r} is not a valid float range.", param, ctx)


OUTPUT = option("output", "-o", "--output", type=FILE, writes=True)
FOLDER = option("output", "-o", metavar="FOLDER", type=click.Path(file_okay=False), writes=True)
PYTHON_ONLY = ("progress", "strains", "announce")
"""Parameters of functions that are no options."""
OPTIONS = {
    each.name: each
    for each in (
        option("engine", type=EngineChoice(ENGINES)),
        option("jobs", type=click.IntRange(1, 4096)),
        option("cluster", metavar="tcp://HOST:PORT"),
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
        option("outputs", "--output", metavar="NODE", multiple=True),
        option("checks", "--check", metavar="NAME=LIMIT", multiple=True),
        option("expect", metavar="V(NODE)=VALUE", multiple=True),
        option("tolerances", metavar="FILE", type=FILE, reads=True),
        option("dialect", type=click.Choice(DIALECTS)),
        option("min_yield", type=NumberRange(0, 1)),
        option("corner", multiple=True, metavar="KEY=Z,..."),
        option("port", type=click.IntRange(0, 65535)),
        option("reach", type=NumberRange(1, 1000, min_open=True)),
        option("settling", metavar="TIME"),
        option("rise", metavar="TIME"),
        option("opamps", metavar="A,B,C"),
        option("c_range", metavar="LOW:HIGH"),
        option("gain_range", metavar="LOW:HIGH"),
        replace(OUTPUT, name="store", flags=("--store",)),
        option("transients", "--confirm/--no-confirm"),
        option("fix", multiple=True, metavar="KEY[=VALUE]"),
        option("baseline", type=click.Path(), metavar="FILE", reads=True),
        option("budget", type=NumberRange(min=0.5)),
        option("pins", metavar="ROLE,ROLE,..."),
        option("compensation", metavar="FARADS"),
        option("limit", metavar="SECONDS", type=NumberRange(0, 86400, min_open=True)),
    )
}
"""What options have beside their names, defaults and sentences, in every command that has them."""


def own_file(found: Any, options: Options) -> list[str]:
    """Return the file of ``-o``, which the function has written."""
    return [] if options["output"] is None else [options["output"]]


TWO_BOARDS = "two scene files, decks (.cir), or records (.raw)"
ARGUMENTS = {
    "scene": "a scene file, such as board.toml; `taction new board.toml` writes one",
    "folder": "a folder with scene files",
    "first": TWO_BOARDS,
    "second": TWO_BOARDS,
    "deck": "a SPICE deck, such as filter.cir",
    "file": "a vendor's netlist with the op-amp as a subcircuit",
    "name": "the name of a preset; `taction parts` lists them",
}
"""What the arguments of the commands are, by name."""
BOARDS = ("scene", "first", "second")
"""Arguments that are one board. Of several boards a wrong one is a row of the result."""


def made(name: str, command: Command, above: str = "") -> click.Command:
    """Return a command, with those below it, as a command of click."""

    def callback(**given: Any) -> None:
        if click.get_current_context().invoked_subcommand is None:
            run(command, given, above + name)

    text = "Print one JSON document on stdout and everything else on stderr."
    as_json = click.Option(["--json", "as_json"], is_flag=True, help=text)
    about = "\n\n".join(filter(None, (beginning(command.function), command.ends)))
    same: dict[str, Any] = {
        "params": [*(each.made(command.function) for each in command.every), as_json],
        "callback": callback,
        "help": about,
    }
    if command.commands:
        below = {short: made(short, each, f"{name}-") for short, each in command.commands.items()}
        return click.Group(name, below, invoke_without_command=True, **same)
    line = " ".join(about.partition("\n\n")[0].split())
    return click.Command(name, short_help=line, **same)


def run(command: Command, given: Options, name: str) -> None:
    """Run the command `name` with its options, show the result, and end with the exit status."""
    job = command.other(given) or command
    _check(command, job, given)
    if job.before is not None:
        job.before(given)
    if given.get("scene") is not None:
        from taction.netlist_gen.scene.axes import questions

        for question in questions(given["scene"]):
            say(f"question: {question}")
    result, interrupted = _result(job, given)
    tell(f"wrote {visible(name)}" for name in job.files(result, given))
    written = _write(job, result, given)  # before the text: its reader may go
    if job.after is not None:
        attempt("the remarks", partial(job.after, result), None, say, is_of_stdout)
    if result is not None and given["as_json"]:
        print_json(result, job.schema or name)
    elif result is not None:
        _show(job, result)
    if interrupted:
        say(f"interrupted; {interrupted}")
    sys.exit(INTERRUPTED if interrupted else status_of(result) if written else 2)


def status_of(result: Any) -> int:
    """Return the exit status of a result: its own, that of its outcome, or 0."""
    status = getattr(result, "exit_status", None)
    if status is None:
        outcome = getattr(result, "outcome", "pass")
        status = STATUS[getattr(outcome, "value", outcome)]
    return int(status)


def _result(job: Command, given: Options) -> tuple[Any, str]:
    """Run the function; return its result, and after Ctrl-C what is kept."""
    function: Callable[..., Any] = getattr(taction, job.function)
    known = signature(job.function)
    arguments = {name: given[name] for name in known if given.get(name) is not None}
    if job.work is None and "progress" not in known:
        return function(**arguments), ""
    try:
        with display() as progress:
            if job.work is not None:
                return job.work(given, progress), ""
            return function(**arguments, progress=progress), ""
    except Interrupted as end:
        if end.result is None:
            raise
        return end.result, str(end)


def _check(command: Command, job: Command, given: Options) -> None:
    """Refuse, before any work, a scene with mistakes and an output that cannot be written.

    Neither may an output be an input, or another output. A scene that is read takes the place of
    its name.
    """
    parameters, inputs = command.every, list[str]()
    written = [each for each in parameters if each.writes and given[each.name] is not None]
    asked = {each: given[each.name] for each in written}
    for each, file in asked.items():
        if each.option in ENDINGS:
            check_file(file, each.option)
    for parameter in parameters:
        if parameter.reads:
            value = given[parameter.name]
            names = value if isinstance(value, tuple) else [value] if value is not None else []
            inputs += names
            # A board is refused where it is read, as in Python.
            expected = ARGUMENTS.get(parameter.name.removesuffix("s"))
            for name in names if expected and parameter.name not in BOARDS else ():
                if not (name.endswith(".toml") or os.path.lexists(name)):
                    text = f"No such file or directory; expected {expected}"
                    raise InputError(name, Complaint("file", "", text))
    if given.get("scene") is not None:
        from taction.netlist_gen.scene.scene import load_scene

        given |= {"scene": load_scene(given["scene"])}
    if asked:
        from taction.verification.report.output_checks import check_separate

        check_separate(inputs, {each.option: file for each, file in asked.items()})
    for each, file in asked.items():
        if each.attributes["type"].file_okay:
            check_folder(file, each.option)
        if each.write is not None and each not in job.outputs:
            raise InputError(each.option, Complaint("FILE", repr(file), job.lacks))


def _write(job: Command, result: Any, given: Options) -> bool:
    """Write the files that show the result, also after an error; return whether all are right."""

    def write(output: CommandParameter) -> bool:
        try:
            load(output.write or "")(result, given[output.name])
        except InputError as error:
            say(str(error))
            return False
        tell([f"wrote {visible(given[output.name])}"])
        return True

    asked = [output for output in job.outputs if given[output.name] is not None]
    written = [attempt(f"--{each.name}", partial(write, each), True, say) for each in asked]
    return all(written)


def _show(job: Command, result: Any) -> None:
    """Print the result; a text that fails ends with the outcome."""

    def show() -> None:
        if job.text is not None:
            load(job.text)(result)
            return
        from taction.verification.report.renderers.terminal import print_page

        print_page(load(job.view)(result), console())

    def failed(text: str) -> None:
        say(text)
        click.echo(str(getattr(result, "outcome", "")).upper())

    attempt("the text", show, None, failed, is_of_stdout)


def is_of_stdout(error: BaseException) -> bool:
    """Whether a stream takes no more; a full disk elsewhere is another error of ours."""
    return isinstance(error, OSError) and error.errno in (errno.EPIPE, *FULL)
