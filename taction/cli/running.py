"""One way for all commands: checks, questions, progress, Ctrl-C, files, the result, exit status."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import click

import taction
from taction.cli.command import (
    Call,
    Command,
    CommandParameter,
    Job,
    OutputOption,
    beginning,
    load,
    signature,
)
from taction.cli.ending import ARGUMENTS, of_stdout
from taction.cli.printing import STATUS, console, display, print_json, say
from taction.system.errors import INTERRUPTED, Complaint, InputError, Interrupted, TactionError
from taction.system.foreign_files import visible
from taction.system.progress import attempt

if TYPE_CHECKING:
    from taction.netlist_gen.scene.scene import Scene

BOARDS = ("scene", "first", "second")
"""Arguments that are one board. Of several boards a wrong one is a row of the result."""


def made(name: str, command: Command) -> click.Command:
    """Return a command, with those below it, as a command of click."""

    def callback(**given: Any) -> None:
        context = click.get_current_context()
        if context.invoked_subcommand is None:
            run(command, given)

    text = "Print one JSON document on stdout and everything else on stderr."
    as_json = click.Option(["--json", "as_json"], is_flag=True, help=text)
    function = command.function
    parameters = [*(each.made(function) for each in command.every), as_json]
    about = "\n\n".join(filter(None, (beginning(function), command.ends)))
    line = " ".join(about.partition("\n\n")[0].split())
    if not command.commands:
        return click.Command(
            name, params=parameters, callback=callback, help=about, short_help=line
        )
    below = {short: made(short, each) for short, each in command.commands.items()}
    return click.Group(
        name,
        below,
        params=parameters,
        callback=callback,
        help=about,
        invoke_without_command=True,
    )


def run(command: Command, given: dict[str, Any]) -> None:
    """Run a command with its options, show the result, and end with the exit status."""
    job = (command.other and command.other(given)) or command
    _check(command, job, given)
    # Of an option without a value the function's own default counts.
    known = {name: each.default for name, each in signature(job.function).items()}
    asked = {name: value for name, value in given.items() if name in known}
    unset = {name for name, value in asked.items() if value is None and known[name] is not None}
    unset -= {name for name in unset if known[name] is inspect.Parameter.empty}
    call = Call(asked | {name: known[name] for name in unset}, given)
    if job.before is not None:
        job.before(call)
    if "scene" in given:
        _ask(given["scene"])
    result, interrupted = _result(job, call)
    status = status_of(result)
    for name in job.files(result, call) if job.files is not None else ():
        click.echo(f"wrote {visible(name)}", err=True)
    written = _write(job, result, given)  # before the text: its reader may go
    if job.after is not None:
        attempt("the remarks", partial(job.after, result, call), None, say, is_of_stdout)
    _show(job, result, call)
    if interrupted:
        say(f"interrupted; {interrupted}")
    sys.exit(INTERRUPTED if interrupted else status if written else 2)


def status_of(result: Any) -> int:
    """Return the exit status of a result: its own, that of its outcome, or 0."""
    status = getattr(result, "exit_status", None)
    if status is None:
        outcome = getattr(result, "outcome", "pass")
        status = STATUS[getattr(outcome, "value", outcome)]
    return int(status)


def _result(job: Job, call: Call) -> tuple[Any, str]:
    """Run the function; return its result, and after Ctrl-C what is kept."""
    function: Callable[..., Any] = getattr(taction, job.function)
    if job.work is None and "progress" not in signature(job.function):
        return function(**call.arguments), ""
    try:
        with display() as progress:
            if job.work is not None:
                return job.work(call, progress), ""
            return function(**call.arguments, progress=progress), ""
    except Interrupted as end:
        if end.result is None:
            raise
        return end.result, str(end)
    except TactionError as error:
        if job.failed is not None:
            job.failed(error, call)
        raise


def _check(command: Command, job: Job, given: dict[str, Any]) -> None:
    """Refuse, before any work, a scene with mistakes and an output that cannot be written.

    Neither may an output be an input, or another output. A scene that is read takes the place of
    its name.
    """
    for output in command.outputs:
        if output.check is not None and given[output.name] is not None:
            load(output.check)(given[output.name])
    for parameter in command.every:
        if parameter.reads and parameter.name not in BOARDS:
            _refuse_missing(parameter, _names(given[parameter.name]))
    inputs = [name for p in command.every if p.reads for name in _names(given[p.name])]
    if given.get("scene") is not None:
        from taction.netlist_gen.scene.loading import load_scene

        given |= {"scene": load_scene(given["scene"])}
    asked = {p: given[p.name] for p in command.every if p.writes and given[p.name]}
    if asked:
        from taction.verification.report.output_checks import check_folder, check_separate

        check_separate(inputs, {p.option: file for p, file in asked.items()})
        for parameter, file in asked.items():
            if not _is_folder(parameter):
                check_folder(file, parameter.option)
    for parameter in command.every:
        value = given[parameter.name]
        if parameter.check is not None and value is not None:
            for each in value if isinstance(value, tuple) else (value,):
                load(parameter.check)(each)
    able = {output.name for output in job.outputs}
    for output in command.outputs:
        if given[output.name] is not None and output.name not in able:
            complaint = Complaint("FILE", repr(given[output.name]), job.lacks)
            raise InputError(f"--{output.name}", complaint)


def _refuse_missing(parameter: CommandParameter, names: Iterable[str]) -> None:
    """Refuse a file that does not exist, where the command says what it expects there.

    A board is refused where it is read, as in Python.
    """
    expected = ARGUMENTS.get(parameter.name.removesuffix("s"))
    for name in names:
        if expected and not (name.endswith(".toml") or os.path.lexists(name)):
            text = f"No such file or directory; expected {expected}"
            raise InputError(name, Complaint("file", "", text))


def _names(value: Any) -> Iterator[str]:
    yield from value if isinstance(value, tuple) else [value] if value else []


def _is_folder(parameter: CommandParameter) -> bool:
    kind = parameter.attributes.get("type")
    return isinstance(kind, click.Path) and not kind.file_okay


def _ask(scene: Scene | None) -> None:
    """Ask on stderr what may be a slip in the scene."""
    from taction.netlist_gen.scene.slips import questions

    for question in questions(scene) if scene is not None else ():
        say(f"question: {question}")


def _write(job: Job, result: Any, given: Mapping[str, Any]) -> bool:
    """Write the files that show the result, also after an error; return whether all are written."""
    complete = True
    for output in job.outputs:
        path = given[output.name]
        if path is None:
            continue

        def write(output: OutputOption = output, path: str = path) -> None:
            load(output.write)(result, path)
            click.echo(f"{output.verb} {visible(path)}", err=True)

        try:
            attempt(f"--{output.name}", write, None, say, _is_bad_input)
        except InputError as error:
            say(str(error))
            complete = False
    return complete


def _print(job: Job, result: Any) -> None:
    if job.text is not None:
        load(job.text)(result)
        return
    from taction.verification.report.renderers.terminal import print_page

    print_page(load(job.view)(result), console())


def _show(job: Job, result: Any, call: Call) -> None:
    if not call.as_json:
        ending = str(getattr(result, "outcome", "")).upper()
        failed: list[str] = []
        attempt("the text", lambda: _print(job, result), None, failed.append, is_of_stdout)
        for line in failed:
            say(line)
            click.echo(ending)
        return
    document = load(job.document)(result)
    if not isinstance(document, Iterator):
        print_json(document, "" if job.schema is None else job.schema or None)
        return
    for part in document:
        click.echo(part, nl=False)


def _is_bad_input(error: Exception) -> bool:
    return isinstance(error, InputError)


def is_of_stdout(error: Exception) -> bool:
    """Whether stdout takes no more, which is no fault of the step that prints."""
    return isinstance(error, OSError) and of_stdout(error)
