"""How a command ends: messages, JSON for errors, exit statuses, streams and signals.

Python itself ends with 1 for an unexpected exception, and libraries end with 1 where a pipe is
closed. Here 1 means that a check failed, so every end passes through `run_command`.
"""

from __future__ import annotations

import errno
import os
import re
import resource
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO

import click

from taction.cli.printing import STATUS, print_json, say
from taction.system.errors import (
    INTERRUPTED,
    Complaint,
    InputError,
    Interrupted,
    NoVerdictError,
    TactionError,
)
from taction.system.foreign_files import visible, visible_lines
from taction.system.processes import ending_signals

CLOSED_PIPE = 141  # as a shell says of a program that SIGPIPE ended
LEAST_MEMORY = 400_000_000  # bytes of address space: numpy and SciPy need 230 MB
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a stream that takes no more
LACKING = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM, errno.EROFS, errno.EACCES, *FULL)
"""What a system refuses to a program that is right."""
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


def run_command(function: Callable[[], object], *, as_json: bool) -> int:
    """Run a command, report its error, and return its exit status.

    `function`: runs the command. Its `SystemExit` has the exit status.
    `as_json`: whether an error is also a JSON document on stdout.

    The status is that of the command or of its error; 3 after an unexpected exception or if stdout
    takes no more; 141 if the reader of stdout has gone; 128 and the number of the signal after
    SIGINT, SIGTERM or SIGHUP, which run all clean-up first.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed: what is opened takes its number
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    with ending_signals() as received:
        try:
            status = _status(function, as_json, received)
            sys.stdout.flush()
        except BrokenPipeError:
            _leave(sys.stdout)
            return CLOSED_PIPE
        except OSError as error:
            _leave(sys.stdout)
            with suppress(OSError):  # stderr, neither
                say(f"stdout cannot be written: {error.strerror}")
            return STATUS["inconclusive"]
        finally:
            try:
                sys.stderr.flush()
            except (OSError, ValueError):  # it is full: else Python ends with 120
                _leave(sys.stderr)
    # A page that is served until Ctrl-C ends well by Ctrl-C, and only by it.
    ended = received and (status == INTERRUPTED or received[0] != signal.SIGINT)
    return 128 + received[0] if ended else status


def _status(function: Callable[[], object], as_json: bool, received: list[int]) -> int:
    """Run a command, say its error, and return its exit status."""
    try:
        memory = resource.getrlimit(resource.RLIMIT_AS)[0]
        if memory != resource.RLIM_INFINITY and memory < LEAST_MEMORY:
            found = f"the memory is limited to {memory / 1e6:.0f} MB (ulimit -v)"
            raise NoVerdictError(f"{found}; expected {LEAST_MEMORY / 1e6:g} MB or more")
        function()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except click.exceptions.Exit as end:
        return end.exit_code
    except (KeyboardInterrupt, click.Abort, Exception) as error:
        if isinstance(error, OSError) and of_stdout(error):
            raise
        if received or not isinstance(error, Exception) or isinstance(error, click.Abort):
            # An error after a signal is the signal: libraries wrap what ends them.
            kept = str(error) if isinstance(error, Interrupted) else "no verdict was reached"
            say(f"interrupted; {kept}")
            return INTERRUPTED
        return _report(error, as_json)
    return 0


def _report(error: Exception, as_json: bool) -> int:
    """Say an error, and return its exit status; a bug is told with its traceback."""
    known = error if isinstance(error, click.ClickException) else _known(error)
    if isinstance(known, click.ClickException):
        text = re.sub(r"is not a valid (integer|float)( range)?\.", "is no number.",
                      known.format_message())  # fmt: skip
        message = visible_lines(text)
    else:
        bug = f"this is a bug in taction; no verdict was reached: {error}"
        message = bug if known is None else str(known)
    if as_json:
        from taction.system.documents import error_document

        print_json(error_document(known or error, message), "error")
    if isinstance(known, click.ClickException):
        if isinstance(known, click.UsageError) and known.ctx is not None:
            hint = f"Try '{known.ctx.command_path} --help' for help."
            click.echo(f"{known.ctx.get_usage()}\n{hint}\n", err=True)
        expected = _expected(known)
        click.echo(f"Error: {message}" + f"\nExpected{expected}" * bool(expected), err=True)
        return known.exit_code
    if known is None:
        import traceback

        traceback.print_exception(error)
    say(message)
    return STATUS["inconclusive"] if known is None else known.exit_status


def _expected(error: click.ClickException) -> str:
    """Return what to write instead, where click does not say it."""
    parameter, context = getattr(error, "param", None), getattr(error, "ctx", None)
    text = error.format_message()
    if isinstance(error, click.MissingParameter) and parameter is not None:
        about = ARGUMENTS.get((parameter.name or "").removesuffix("s"), "")
        about = about or getattr(parameter, "help", None) or ""
        kind = "" if context is None else f" {parameter.make_metavar(context)}"
        return f"{kind}: {about}" * bool(about)
    if "is not a valid" in text and parameter is not None:
        kind = parameter.type
        whole = "a whole number" if isinstance(kind, click.types.IntParamType) else "a number"
        limits = getattr(kind, "_describe_range", str)()
        return f" {whole}{f' in {limits}' if limits else ''}."
    if "unexpected extra argument" in text and context is not None:
        if any(each.name == "over" for each in context.command.params):
            return " one word after each option: --over C=1pF:1nF:3, with '=' and no blank."
        return " no further word; text with blanks needs quotes."
    if "No such command" in text and "Did you mean" not in text and context is not None:
        return f" one of {', '.join(context.command.list_commands(context))}."
    return ""


def of_stdout(error: OSError) -> bool:
    """Whether a stream takes no more; a full disk elsewhere is another error of ours."""
    return error.errno in (errno.EPIPE, *FULL)


def _known(error: Exception) -> TactionError | None:
    """Return an error as one of ours; None for a bug.

    A name that is too long, and links that lead to one another, are found wherever a path is first
    looked at. Libraries hide what the system refuses: an import that finds no free descriptor is an
    `ImportError` with the words of the system.
    """
    if isinstance(error, TactionError):
        return error
    if isinstance(error, MemoryError):
        return NoVerdictError("out of memory: no verdict was reached")
    name, number = getattr(error, "filename", None), getattr(error, "errno", None)
    if name is not None and number in (errno.ENAMETOOLONG, errno.ELOOP):
        reason = f"{os.strerror(number)}; expected a name of up to 255 bytes, no links in a circle"
        return InputError(os.fsdecode(name), Complaint("file", "", reason))
    cause: BaseException | None = error
    while cause is not None and not any(words in str(cause) for words in map(os.strerror, LACKING)):
        cause = cause.__cause__ or cause.__context__
    if cause is None:
        return None
    return NoVerdictError(f"no verdict was reached, the system refuses: {visible(str(cause))}")


def _leave(stream: TextIO) -> None:
    """Discard what a stream still holds, so that Python's end does not try to write again."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
