"""How a command ends: messages, JSON for errors, exit statuses, streams and signals.

Python itself ends with 1 for an unexpected exception, and libraries end with 1 where a pipe is
closed. Here 1 means that a check failed, so every end passes through `run_command`.
"""

from __future__ import annotations

import errno
import io
import os
import re
import resource
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Literal, TextIO

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
from taction.system.foreign_files import visible
from taction.system.processes import ending_signals

CLOSED_PIPE = 141  # as a shell says of a program that SIGPIPE ended
LEAST_MEMORY = 400_000_000  # bytes of address space: numpy and SciPy need 230 MB
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a stream that takes no more


UNUSABLE = (errno.ENAMETOOLONG, errno.ELOOP)  # of the name of a file
LACKING = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM, errno.EROFS, errno.EACCES, *FULL)
"""What a system refuses to a program that is right."""


def run_command(function: Callable[[], object], *, as_json: bool, words: Sequence[str] = ()) -> int:
    """Run a command, report its error, and return its exit status.

    `function`: runs the command. Its `SystemExit` has the exit status.
    `as_json`: whether an error is also a JSON document on stdout.
    `words`: of the command line, which a message may repeat.

    Returns
    -------
    int
        The status of the command; that of its error; 3 after an unexpected exception or if stdout
        takes no more; 141 if the reader of stdout has gone; 128 and the number of the signal after
        SIGINT, SIGTERM or SIGHUP, which run all clean-up first.
    """
    _prepare_streams()
    with ending_signals() as received:
        try:
            status = _status(function, as_json, received, words)
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


def _instead(error: click.ClickException) -> str:
    """Return a line that says what to write instead, where click does not."""
    if isinstance(error, click.MissingParameter) and error.param is not None:
        place = (error.param.name or "").removesuffix("s")
        about = ARGUMENTS.get(place, getattr(error.param, "help", None) or "")
        kind = "" if error.ctx is None else f" {error.param.make_metavar(error.ctx)}"
        return f"Expected{kind}: {about}\n" if about else ""
    text, context = error.format_message(), getattr(error, "ctx", None)
    if isinstance(error, click.BadParameter) and error.param is not None:
        if isinstance(error.param.type, click.Choice):
            return _nearest_choice(error.param.type, text)
        return _number_instead(error.param.type) if "is not a valid" in text else ""
    if context is None:
        return ""
    if "unexpected extra argument" in text:
        options = {parameter.name for parameter in context.command.params}
        if "over" in options:
            return (
                "Expected one word after each option: --over C=1pF:1nF:3, with '=' and no blank.\n"
            )
        return "Expected no further word; text with blanks needs quotes.\n"
    if "No such command" in text and "Did you mean" not in text:
        return f"Expected one of {', '.join(context.command.list_commands(context))}.\n"
    return ""


def _nearest_choice(kind: click.Choice[Any], text: str) -> str:
    """Return a question with the choice nearest to the word that a message refuses."""
    import difflib

    word = text.rpartition(" is not one of ")[0].rpartition(": ")[2].strip("'")
    close = difflib.get_close_matches(word.lower(), map(str, kind.choices), n=1)
    return f"Did you mean {close[0]!r}?\n" if close else ""


def _number_instead(kind: click.ParamType[Any]) -> str:
    """Return what number an option takes, where click names the type of a programmer."""
    if not isinstance(kind, click.IntRange | click.FloatRange | click.types.IntParamType):
        return ""
    whole = "a whole number" if isinstance(kind, click.types.IntParamType) else "a number"
    limits = kind._describe_range() if isinstance(kind, click.IntRange | click.FloatRange) else ""
    return f"Expected {whole}{f' in {limits}' if limits else ''}.\n"


TWO_BOARDS = "two scene files, decks (.cir), records (.raw), or stored verdicts (.json)"
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


def _status(
    function: Callable[[], object], as_json: bool, received: list[int], words: Sequence[str]
) -> int:
    try:
        _refuse_little_memory()
        _run(function, received)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except click.exceptions.Exit as end:
        return end.exit_code
    except click.ClickException as error:
        odd = [word for word in words if word != visible(word)]
        if as_json:
            _print_plain("bad input", error, _told(error.format_message(), odd))
        shown = io.StringIO()
        error.show(shown)
        click.echo(_told(shown.getvalue() + _instead(error), odd), err=True, nl=False)
        return error.exit_code
    except (KeyboardInterrupt, click.Abort) as end:
        kept = str(end) if isinstance(end, Interrupted) else "no verdict was reached"
        say(f"interrupted; {kept}")
        return INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and of_stdout(error):
            raise
        return _report(error, as_json)
    return 0


def _refuse_little_memory() -> None:
    """Refuse a limit of the memory below which a library ends the process, with status 1."""
    memory = resource.getrlimit(resource.RLIMIT_AS)[0]
    if memory != resource.RLIM_INFINITY and memory < LEAST_MEMORY:
        least = f"expected {LEAST_MEMORY / 1e6:g} MB or more"
        raise NoVerdictError(f"the memory is limited to {memory / 1e6:.0f} MB (ulimit -v); {least}")


def _told(text: str, words: Sequence[str]) -> str:
    """Return a message that repeats words of the command line, these as a reader sees them."""
    for word in words:
        text = text.replace(word, visible(word))
    return re.sub(r"is not a valid (integer|float)( range)?\.", "is no number.", text)


def of_stdout(error: OSError) -> bool:
    """Whether a stream takes no more; a full disk elsewhere is another error of ours."""
    return error.errno in (errno.EPIPE, *FULL)


def refusal(error: BaseException | None) -> str:
    """Return what the system refuses: files, processes, memory, disk; empty for another error.

    Libraries hide the number of the error: an import that finds no free descriptor is an
    `ImportError` with the words of the system.
    """
    while error is not None:
        for number in LACKING:
            words = os.strerror(number)
            if getattr(error, "errno", None) == number or words in str(error):
                name = getattr(error, "filename", None)
                file = f" ({visible(str(name))})" if name else ""
                remedy = "; raise `ulimit -n`" if number in (errno.EMFILE, errno.ENFILE) else ""
                return f"no verdict was reached, the system refuses: {words}{file}{remedy}"
        error = error.__cause__ or error.__context__
    return ""


def _known(error: Exception) -> TactionError | None:
    """Return an error as one of ours; None for a bug.

    A name that is too long, and links that lead to one another, are found wherever a path is first
    looked at: before an input is read, and before an output is written.
    """
    if isinstance(error, TactionError):
        return error
    if isinstance(error, MemoryError):
        return NoVerdictError("out of memory: no verdict was reached")
    if isinstance(error, RuntimeError) and str(error).startswith("Symlink loop"):  # Python 3.12
        name, number = str(error).partition(" from ")[2].strip("'"), errno.ELOOP
    elif isinstance(error, OSError) and error.errno in UNUSABLE and error.filename is not None:
        name, number = os.fsdecode(error.filename), error.errno
    else:
        lack = refusal(error)
        return NoVerdictError(lack) if lack else None
    text = f"{os.strerror(number)}; expected a name of up to 255 bytes, and no links in a circle"
    return InputError(name, Complaint("file", "", text))


def _run(function: Callable[[], object], received: list[int]) -> None:
    """Run a command; its error after a signal is the signal: libraries wrap what ends them."""
    try:
        function()
    except Exception as error:
        if received and not isinstance(error, click.exceptions.Exit):
            raise KeyboardInterrupt from error
        raise


def _print_plain(
    outcome: Literal["bad input", "inconclusive"], error: Exception, text: str
) -> None:
    from taction.system.error_document import plain_error

    print_json(plain_error(outcome, error, text), "error")


def _report(error: Exception, as_json: bool) -> int:
    """Say an error, and return its exit status; a bug is told with its traceback."""
    if (known := _known(error)) is not None:
        if as_json:
            from taction.system.error_document import error_document

            print_json(error_document(known), "error")
        say(str(known))
        return known.exit_status
    import traceback

    text = "this is a bug in taction; no verdict was reached"
    if as_json:
        _print_plain("inconclusive", error, f"{text}: {error}")
    traceback.print_exception(error)
    say(text)
    return STATUS["inconclusive"]


def _prepare_streams() -> None:
    """Open closed descriptors, so that no file gets their numbers; write unknown signs as ``?``."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _leave(stream: TextIO | None) -> None:
    """Discard what a stream still holds, so that Python's end does not try to write again."""
    if stream is not None:
        with suppress(OSError, ValueError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
