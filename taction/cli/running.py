"""One way for all commands: checks, questions, progress, Ctrl-C, files, the result, exit status."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import click

import taction
from taction.cli.command import (
    Call,
    Command,
    CommandParameter,
    Job,
    beginning,
    load,
    signature,
)
from taction.cli.ending import ARGUMENTS, of_stdout
from taction.cli.printing import STATUS, console, display, print_json, say
from taction.system.errors import INTERRUPTED, Complaint, InputError, Interrupted, TactionError
from taction.system.foreign_files import visible
from taction.system.progress import attempt

BOARDS = ("scene", "first", "second")
"""Arguments that are one board. Of several boards a wrong one is a row of the result."""


def made(name: str, command: Command) -> click.Command:
    """Return a command, with those below it, as a command of click."""

    def callback(**given: Any) -> None:
        if click.get_current_context().invoked_subcommand is None:
            run(command, given)

    text = "Print one JSON document on stdout and everything else on stderr."
    as_json = click.Option(["--json", "as_json"], is_flag=True, help=text)
    about = "\n\n".join(filter(None, (beginning(command.function), command.ends)))
    same: dict[str, Any] = {
        "params": [*(each.made(command.function) for each in command.every), as_json],
        "callback": callback,
        "help": about,
    }
    if command.commands:
        below = {short: made(short, each) for short, each in command.commands.items()}
        return click.Group(name, below, invoke_without_command=True, **same)
    line = " ".join(about.partition("\n\n")[0].split())
    return click.Command(name, short_help=line, **same)


def run(command: Command, given: dict[str, Any]) -> None:
    """Run a command with its options, show the result, and end with the exit status."""
    job = (command.other and command.other(given)) or command
    _check(command, job, given)
    known = signature(job.function)
    call = Call({name: value for name, value in given.items() if name in known}, given)
    for name in [name for name, value in call.arguments.items() if value is None]:
        if known[name].default is not inspect.Parameter.empty:  # which counts
            call.arguments[name] = known[name].default
    if job.before is not None:
        job.before(call)
    if given.get("scene") is not None:
        from taction.netlist_gen.scene.slips import questions

        for question in questions(given["scene"]):
            say(f"question: {question}")
    result, interrupted = _result(job, call)
    status = status_of(result)
    for name in job.files(result, call):
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
    parameters, inputs = command.every, list[str]()
    for output in command.outputs:
        _apply_check(output, given)
    for parameter in parameters:
        if parameter.reads:
            names = list(_each(given[parameter.name]))
            inputs += names
            # A board is refused where it is read, as in Python.
            expected = ARGUMENTS.get(parameter.name.removesuffix("s"))
            for name in names if expected and parameter.name not in BOARDS else ():
                if not (name.endswith(".toml") or os.path.lexists(name)):
                    text = f"No such file or directory; expected {expected}"
                    raise InputError(name, Complaint("file", "", text))
    if given.get("scene") is not None:
        from taction.netlist_gen.scene.loading import load_scene

        given |= {"scene": load_scene(given["scene"])}
    asked = {each: given[each.name] for each in parameters if each.writes and given[each.name]}
    if asked:
        from taction.verification.report.output_checks import check_folder, check_separate

        check_separate(inputs, {each.option: file for each, file in asked.items()})
        for parameter, file in asked.items():
            if not parameter.is_folder:
                check_folder(file, parameter.option)
    for parameter in parameters:
        if parameter.write is None:
            _apply_check(parameter, given)
        elif given[parameter.name] is not None and parameter not in job.outputs:
            value = repr(given[parameter.name])
            raise InputError(parameter.option, Complaint("FILE", value, job.lacks))


def _apply_check(parameter: CommandParameter, given: Mapping[str, Any]) -> None:
    for each in _each(given[parameter.name]):
        if parameter.check is not None:
            load(parameter.check)(each)


def _each(value: Any) -> Iterator[Any]:
    """Yield the values of a parameter, which may have none or several."""
    yield from value if isinstance(value, tuple) else [value] if value is not None else []


def _write(job: Job, result: Any, given: Mapping[str, Any]) -> bool:
    """Write the files that show the result, also after an error; return whether all are written."""
    complete = True
    for output in job.outputs:
        path = given[output.name]
        if path is None or output.write is None:
            continue

        def write(output: CommandParameter = output, path: str = path) -> None:
            load(output.write or "")(result, path)
            click.echo(f"{output.verb} {visible(path)}", err=True)

        try:
            attempt(f"--{output.name}", write, None, say, _is_bad_input)
        except InputError as error:
            say(str(error))
            complete = False
    return complete


def _show(job: Job, result: Any, call: Call) -> None:
    """Print the result, or its document; a text that fails ends with the outcome."""

    def show() -> None:
        if job.text is not None:
            load(job.text)(result)
            return
        from taction.verification.report.renderers.terminal import print_page

        print_page(load(job.view)(result), console())

    if not call.as_json:
        failed: list[str] = []
        attempt("the text", show, None, failed.append, is_of_stdout)
        for line in failed:
            say(line)
            click.echo(str(getattr(result, "outcome", "")).upper())
        return
    document = load(job.document)(result)
    if isinstance(document, Iterator):
        for part in document:
            click.echo(part, nl=False)
    else:
        print_json(document, "" if job.schema is None else job.schema or None)


def _is_bad_input(error: Exception) -> bool:
    return isinstance(error, InputError)


def is_of_stdout(error: Exception) -> bool:
    """Whether stdout takes no more, which is no fault of the step that prints."""
    return isinstance(error, OSError) and of_stdout(error)
