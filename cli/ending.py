"""How a command ends: messages, JSON for errors, exit statuses, streams and signals.

Python itself ends with 1 for an unexpected exception, and libraries end with 1 where a pipe is
closed. Here 1 means that a check failed, so every end passes through `run_command`.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Literal

import click

from taction.cli.terminal import STATUS, print_json
from taction.system.errors import (
    INTERRUPTED,
    Interrupted,
    NoVerdictError,
    TactionError,
)

CLOSED_PIPE = 141  # as a shell says of a program that SIGPIPE ended
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
AGAIN = 0.02  # s until a signal comes again whose exception was lost
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a stream that takes no more


def run_command(function: Callable[[], object], *, as_json: bool) -> int:
    """Run a command, report its error, and return its exit status.

    Parameters
    ----------
    function : callable
        Runs the command. Its `SystemExit` has the exit status.
    as_json : bool
        Whether an error is also a JSON document on stdout.

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
            status = _status(function, as_json, received)
            sys.stdout.flush()
        except BrokenPipeError:
            _leave_stdout()
            return CLOSED_PIPE
        except OSError as error:
            if error.errno not in FULL:
                raise
            _leave_stdout()
            click.echo(f"taction: stdout cannot be written: {error.strerror}", err=True)
            return STATUS["inconclusive"]
    return 128 + received[0] if received and status == INTERRUPTED else status


def _status(function: Callable[[], object], as_json: bool, received: list[int]) -> int:
    try:
        _run(function, received)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except click.exceptions.Exit as end:
        return end.exit_code
    except TactionError as error:
        return _report(error, as_json)
    except MemoryError:
        return _report(NoVerdictError("out of memory: the scene is too large"), as_json)
    except click.ClickException as error:
        if as_json:
            _print_plain("bad input", error, error.format_message())
        error.show()
        return error.exit_code
    except (KeyboardInterrupt, click.Abort) as end:
        kept = str(end) if isinstance(end, Interrupted) else "no verdict was reached"
        click.echo(f"taction: interrupted; {kept}", err=True)
        return INTERRUPTED
    except OSError as error:
        if error.errno in (errno.EPIPE, *FULL):
            raise
        return _bug(error, as_json)
    except Exception as error:
        return _bug(error, as_json)
    return 0


def _run(function: Callable[[], object], received: list[int]) -> None:
    """Run a command; its error after a signal is the signal: pydantic wraps what interrupts it."""
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


def _bug(error: Exception, as_json: bool) -> int:
    import traceback

    text = "this is a bug in taction; no verdict was reached"
    if as_json:
        _print_plain("inconclusive", error, f"{text}: {error}")
    traceback.print_exception(error)
    click.echo(f"taction: {text}", err=True)
    return STATUS["inconclusive"]


def _report(error: TactionError, as_json: bool) -> int:
    if as_json:
        from taction.system.error_document import error_document

        print_json(error_document(error), "error")
    click.echo(f"taction: {error}", err=True)
    return error.exit_status


def _prepare_streams() -> None:
    """Replace closed streams, and let every stream write what its encoding lacks as ``?``."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the shell: `2>&-`
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _leave_stdout() -> None:
    """Discard what stdout still holds, so that Python's end does not try to write again."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


class Ended(KeyboardInterrupt):
    """A signal of `ENDING`; after a plain `KeyboardInterrupt` Python may end itself by SIGINT."""


@contextmanager
def ending_signals() -> Iterator[list[int]]:
    """Raise `Ended` once at a signal of `ENDING`; the list receives the numbers of the signals.

    A signal that the process ignores, as below nohup, stays ignored. After the first signal a
    second one of its kind cannot stop the clean-up, nor the end of Python.
    """
    received: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)
        received.append(number)
        raise Ended

    def show(lost: Any) -> None:
        """Send a signal again whose exception Python has dropped, as in a callback."""
        if not isinstance(lost.exc_value, Ended):
            hook(lost)
            return
        number = received.pop()
        signal.signal(number, end)
        threading.Timer(AGAIN, os.kill, (os.getpid(), number)).start()

    before: dict[int, Any] = {}
    usual = (signal.SIG_DFL, signal.default_int_handler)
    for name in ENDING:
        number = getattr(signal, name, None)  # SIGHUP is unknown on some systems
        if number is not None and signal.getsignal(number) in usual:
            with suppress(ValueError):  # not the main thread
                before[number] = signal.signal(number, end)
    hook, sys.unraisablehook = sys.unraisablehook, show
    try:
        yield received
    finally:
        sys.unraisablehook = hook
        for number in before.keys() - received:
            signal.signal(number, before[number])
