"""The command ``taction``: the group of all commands, and how each of them ends.

A command is made when it is called. ``taction --json --help`` prints every command as one document,
as click describes it.

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
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NoReturn, TextIO

import click

from taction.cli.command import ARGUMENTS, FULL, is_of_stdout, made
from taction.cli.commands import COMMANDS
from taction.cli.printing import STATUS, print_json, say
from taction.system.errors import (
    INTERRUPTED,
    Complaint,
    InputError,
    Interrupted,
    NoVerdictError,
    TactionError,
    nearest_question,
)
from taction.system.foreign_files import visible, visible_lines
from taction.system.processes import THREADS, ending_signals

CLOSED_PIPE = 141  # as a shell says of a program that SIGPIPE ended
LEAST_MEMORY = 400_000_000  # bytes of address space: numpy and SciPy need 230 MB
LACKING = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM, errno.EROFS, errno.EACCES, *FULL)
"""What a system refuses to a program that is right."""

PROGRAM = "taction"
FAMILIES = {
    "design": (("tune", "choose", "scale"), "Search for a better board: tune, choose, scale."),
    "yield": (("montecarlo", "corners"), "See what tolerances of parts do: montecarlo, corners."),
    "export": (("bom", "waveforms"), "Write parts list or waveforms: bom, waveforms."),
    "self": (("accuracy", "stress"), "Examine taction: accuracy, stress."),
}
"""By name: the commands below it, and its line of --help."""
RENAMED = {"parts": "models", "waveforms": "simulate"}
WITHDRAWN = {
    "refine": "It was withdrawn: simulate the board again with the residual as its strain;"
    " 'Refinement' in docs/closed-loop.md has the theory.",
    "check --matrix": "It was withdrawn: expect the optimum at every output, such as"
    " --expect 'v(out1)=1.25@0.1%'; 'taction new --matrix' and 'taction verify' find it.",
    "check -o": "The command 'listing expand' of ngspice has the flat cards of a deck.",
    "doctor": "What is missing is said where it is needed, with the command that installs it.",
    "netlist --explain": "--json lists what is left out, and so does the report of verify.",
    "netlist --split": "It was withdrawn: the cards Rf_ and Rb_ of the deck are the matrix.",
    "kicad": "'taction build SCENE -o FOLDER' writes the drawing into FOLDER/kicad.",
    "verify --solve": "'taction solve SCENE' prints the numerical solution.",
    "new --schema": "It is docs/scene.schema.json, and in Python taction.scene_schema().",
    "new -o": "The file is named alone: taction new FILE.",
    "new --from": "'taction scale SCENE -o FILE' writes the scene with scaled values.",
    "choose --topology": "A choice is of one topology: set design.topology of the scene.",
    "montecarlo --remedy": "Set a better grade in [tolerances] for parts that the corners name.",
    "montecarlo --no-remedy": "Leave it out: no samples are drawn again.",
    "verify --exclude": "Name the scenes, or keep drafts in a folder of their own.",
    "verify --annotate": "--junit FILE writes what CI shows at the files.",
    "regress --annotate": "--junit FILE and --markdown FILE write what CI shows.",
    "montecarlo --sample": "Verify a board of your own by 'taction yield corners --corner'.",
    "montecarlo --until": "Give the samples by -n; the same command with more of them goes on.",
    **{
        f"{name} --any-part": "Parts that the scene itself has are accepted, and no worse ones."
        for name in ("verify", "new", "scale", "tune", "choose")
    },
    "reproduce --quick": "Leave it out: all claims take a minute.",
    "sweep --retry": "The same command computes points without a verdict again.",
    "sweep --keep-waveforms": "Write the waveforms of a board with 'taction export waveforms'.",
}
"""What to do in the place of a command that is no more, or of one of its options."""
SECTIONS = {
    "Start": ("new", "verify", "netlist", "explore"),
    "Design": ("design", "onset", "sweep", "yield", "build", "export"),
    "Check": ("check", "solve", "regress", "diff", "reproduce"),
    "": ("parts", "self", "demo", "mcp"),
}
"""The listed commands by their heading; the last ones have none."""
HELP = {"--help", "-h"}


class LazyGroup(click.Group):
    """A click group whose commands are made when they are used.

    `known`: every name that works, with that in `COMMANDS` or `FAMILIES`.
    `sections`: the names that are listed.
    """

    def __init__(
        self, *, known: Mapping[str, str], sections: Mapping[str, Sequence[str]], **more: Any
    ) -> None:
        super().__init__(**more)
        self.known, self.sections = known, sections

    def main(self, args: Sequence[str] | None = None, *_: Any, **more: Any) -> NoReturn:
        """Run the command of `args` and end the process with the command's exit status.

        click's own `main` ends with 1 where a pipe is closed.
        """
        words = list(sys.argv[1:] if args is None else args)
        more.pop("prog_name", None)

        def run() -> None:
            self._main_shell_completion({}, PROGRAM)
            names = [word for word in words if word not in ("--json", *HELP)]
            if "--json" in words and HELP & {*words} and {*names} <= {*self.list_commands(None)}:
                print_json({"commands": self._described(names or self.list_commands(None))}, "")
                return
            try:
                given = words.copy() or ["--help"]
                with self.make_context(PROGRAM, given, **more) as context:
                    self.invoke(context)
            except click.NoSuchOption as error:
                name = error.ctx.command.name if error.ctx else ""
                if hint := WITHDRAWN.get(f"{name} {error.option_name}"):
                    text = f"No such option '{error.option_name}'. {hint}"
                    raise click.UsageError(text, error.ctx) from None
                raise

        sys.exit(run_command(run, as_json="--json" in words))

    def _described(self, names: Sequence[str]) -> dict[str, Any]:
        """Return commands, and those below them, as plain data."""
        with self.make_context(PROGRAM, [], resilient_parsing=True) as context:
            made = {name: self.get_command(context, name) for name in names}
            return {name: each.to_info_dict(context) for name, each in made.items() if each}

    def list_commands(self, ctx: click.Context | None) -> list[str]:
        """Return the listed commands in their order."""
        return [name for names in self.sections.values() for name in names]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Make one command."""
        name = self.known.get(cmd_name)
        if name is None:
            return None
        if name in FAMILIES:
            below, about = FAMILIES[name]
            known = {short: RENAMED.get(short, short) for short in below}
            return LazyGroup(known=known, sections={"Commands": below}, help=about)
        return made(name, COMMANDS[name])

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the tables, without making them."""
        width = max(len(name) for name in self.list_commands(ctx))
        about = {name: each.about for name, each in COMMANDS.items()}
        about |= {name: line for name, (_, line) in FAMILIES.items()}
        for title, names in self.sections.items():
            rows = [(name.ljust(width), about[self.known[name]]) for name in names]
            if not title:
                formatter.write_paragraph()
            with formatter.section(title) if title else formatter.indentation():
                formatter.write_dl(rows)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Find the command as click does; for an unknown name propose the nearest command."""
        if args and args[0] not in self.known:
            hint = WITHDRAWN.get(args[0]) or nearest_question(args[0], self.known, 0.6).capitalize()
            ctx.fail(f"No such command '{visible(args[0])}'. {hint}".rstrip())
        return super().resolve_command(ctx, args)


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
        if is_of_stdout(error):
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


@click.group(
    cls=LazyGroup,
    known={name: name for name in (*FAMILIES, *COMMANDS)} | RENAMED,
    sections=SECTIONS,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(package_name="taction", prog_name=PROGRAM)
def main() -> None:
    """Design and verify regularising op-amp and resistor networks with SPICE.

    Exit status: 0 pass, 1 a check failed, 2 bad input, 3 no verdict. `taction --json --help` prints
    all commands and options as one JSON document.
    """
    # ngspice uses the other cores. BLAS threads that wait for a busy core spin: the poles of 64
    # channels took a minute instead of a second. Users with free cores can set the variables.
    for name in THREADS:
        os.environ.setdefault(name, "1")
    # Else pydantic reads the entry points of all installed packages, for plug-ins of its own.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
