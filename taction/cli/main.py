"""The command ``taction``: the group of all commands, which are made when they are called.

``taction --json --help`` prints every command with its arguments and options as one document.
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn

import click

from taction.cli.command import made
from taction.cli.commands import COMMANDS
from taction.cli.ending import run_command
from taction.cli.printing import own_name, print_json
from taction.system.errors import nearest_question
from taction.system.foreign_files import visible
from taction.system.processes import THREADS

PROGRAM = "taction"
FAMILIES = {
    "design": (("tune", "choose"), "Search for a better board: tune, choose."),
    "yield": (("montecarlo", "corners"), "See what tolerances of parts do: montecarlo, corners."),
    "export": (
        ("bom", "kicad", "waveforms"),
        "Write parts list, drawing or waveforms: bom, kicad, waveforms.",
    ),
    "self": (("doctor", "accuracy", "stress"), "Examine taction: doctor, accuracy, stress."),
}
"""By name: the commands below it, and its line of --help."""
RENAMED = {"parts": "models", "waveforms": "simulate"}
WITHDRAWN = {
    "refine": "It was withdrawn: simulate the board again with the residual as its strain;"
    " 'Refinement' in docs/closed-loop.md has the theory.",
    "choose --topology": "A choice is of one topology: set design.topology of the scene.",
    "montecarlo --remedy": "Set a better grade in [tolerances] for parts of the table of causes.",
    "montecarlo --no-remedy": "Leave it out: no samples are drawn again.",
    "verify --annotate": "An action that publishes the file of --junit shows it on GitHub.",
    "regress --annotate": "An action that publishes the file of --junit shows it on GitHub.",
    "reproduce --quick": "Leave it out: all claims take a minute.",
    "sweep --retry": "The same command computes points without a verdict again.",
    "sweep --keep-waveforms": "Write the waveforms of a board with 'taction export waveforms'.",
}
"""What to do in the place of a command that is no more, or of one of its options."""
SECTIONS = {
    "Start": ("new", "verify", "netlist", "explore"),
    "Design": ("design", "onset", "sweep", "yield", "build", "export"),
    "Check": ("check", "regress", "diff", "reproduce"),
    "": ("parts", "self", "demo", "mcp"),
}
"""The listed commands by their heading; the last ones have none."""
FIRST_STEPS = """\
taction demo                  the paper's story on three boards; needs no file
taction new board.toml        write a scene with comments
taction verify board.toml     simulate the board and judge it
taction explore board.toml    move C, gain and more and watch the board
taction --help                all commands
"""
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
                print_json(reference(self, names), "")
                return
            if not words:
                click.echo(FIRST_STEPS, nl=False)
                return
            try:
                with self.make_context(PROGRAM, words.copy(), **more) as context:
                    self.invoke(context)
            except click.NoSuchOption as error:
                name = error.ctx.command.name if error.ctx else ""
                if hint := WITHDRAWN.get(f"{name} {error.option_name}"):
                    text = f"No such option '{error.option_name}'. {hint}"
                    raise click.UsageError(text, error.ctx) from None
                raise

        sys.exit(run_command(run, as_json="--json" in words))

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
        for title, names in self.sections.items():
            rows = [(name.ljust(width), _about(self.known[name])) for name in names]
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


def _about(name: str) -> str:
    """Return the line of a command, or of a family of commands, in the list."""
    return FAMILIES[name][1] if name in FAMILIES else COMMANDS[name].about


@click.group(
    cls=LazyGroup,
    name="",  # as of the families: the name of a document is that of its command
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


TYPES = {"Bool": "boolean", "Path": "path", "EngineChoice": "choice", "Choice": "choice",
         "IntRange": "integer", "Int": "integer", "NumberRange": "number"}  # fmt: skip
"""Of parameters, by click's names; any other is a text."""


def reference(main: click.Group, names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the commands, or those of `names` and those below them; made from click."""
    from taction.verification.report.documents.document_catalogue import document_head

    with main.make_context("taction", [], resilient_parsing=True) as context:
        commands = list(_commands(main, context, names))
    return document_head("help") | {
        "program": "taction",
        "usage": "taction COMMAND [OPTIONS] [ARGUMENTS]; --json: one document on stdout",
        "commands": commands,
    }


def _commands(
    group: click.Group, context: click.Context, names: Sequence[str] = ()
) -> Iterator[dict[str, Any]]:
    for short in group.list_commands(context):
        command = group.get_command(context, short)
        if command is None or (names and short not in names):
            continue
        with click.Context(command, info_name=short, parent=context) as inner:
            if command.name:  # a family of commands does nothing itself
                yield _command(command, inner)
            if isinstance(command, click.Group):
                yield from _commands(command, inner)


def _command(command: click.Command, context: click.Context) -> dict[str, Any]:
    from taction.verification.report.documents.document_catalogue import ERROR, MODELS, schema_name

    parameters = command.get_params(context)
    schema = own_name(context)
    documents = [key for key in MODELS if key == schema or key.startswith(f"{schema}-")]
    path = context.command_path
    return {
        "name": path.partition(" ")[2],
        "usage": " ".join([path, *command.collect_usage_pieces(context)]),
        "help": inspect.cleandoc(command.help or ""),
        "arguments": [_parameter(p, context) for p in parameters if isinstance(p, click.Argument)],
        "options": [_parameter(p, context) for p in parameters if isinstance(p, click.Option)],
        "schemas": [schema_name(key) for key in (*documents, ERROR)],
    }


def _parameter(parameter: click.Parameter, context: click.Context) -> dict[str, Any]:
    """Return an argument or an option as plain data."""
    info = parameter.to_info_dict()
    kind = info["type"]
    record: dict[str, Any] = {
        "name": info["name"],
        "type": TYPES.get(kind["param_type"], "text"),
        "required": info["required"],
        "several": bool(info["multiple"]) or info["nargs"] == -1,
    }
    limits = ("min", "max", "choices")
    record |= {key: kind[key] for key in limits if kind.get(key) is not None}
    if isinstance(parameter, click.Option):
        default = parameter.get_default(context)
        record |= {
            "flags": [*parameter.opts, *parameter.secondary_opts],
            "default": default if isinstance(default, str | int | float | bool) else None,
            **{key: getattr(parameter, key) for key in ("is_flag", "metavar", "envvar", "help")},
        }
    return record
