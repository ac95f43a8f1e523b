"""The command ``taction``: the group of all commands, which are made when they are called."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from taction.cli import boards, studies
from taction.cli.command import Command
from taction.cli.ending import run_command
from taction.cli.running import made
from taction.cli.terminal import print_json
from taction.system.processes import THREADS

PROGRAM = "taction"
COMMANDS: dict[str, Command] = {
    "verify": boards.VERIFY,
    "diff": boards.DIFF,
    "netlist": boards.NETLIST,
    "bom": boards.BOM,
    "kicad": boards.KICAD,
    "solve": boards.SOLVE,
    "simulate": boards.SIMULATE,
    "montecarlo": studies.MONTECARLO,
    "corners": studies.CORNERS,
    "explore": boards.EXPLORE,
    "tune": studies.TUNE,
    "choose": studies.CHOOSE,
    "scale": studies.SCALE,
    "onset": studies.ONSET,
    "sweep": studies.SWEEP,
    "regress": studies.REGRESS,
    "stress": studies.STRESS,
    "accuracy": studies.ACCURACY,
    "reproduce": studies.REPRODUCE,
    "models": boards.MODELS,
    "new": boards.NEW,
    "doctor": boards.DOCTOR,
}
REFERENCE = ({"--json", "--help"}, {"--json", "-h"})


def print_reference(group: click.Group) -> None:
    """Print all commands, options, schemas and exit statuses as one JSON document."""
    from taction.cli.reference import reference

    print_json(reference(group), "")


class LazyGroup(click.Group):
    """A click group whose commands are made when they are used."""

    def main(self, args: Sequence[str] | None = None, *_: Any, **more: Any) -> NoReturn:
        """Run the command of `args` and end the process with the command's exit status.

        click's own `main` ends with 1 where a pipe is closed.
        """
        words = list(sys.argv[1:] if args is None else args)
        more.pop("prog_name", None)

        def run() -> None:
            self._main_shell_completion({}, PROGRAM)
            if set(words) in REFERENCE:
                print_reference(self)
                return
            with self.make_context(PROGRAM, words.copy(), **more) as context:
                self.invoke(context)

        sys.exit(run_command(run, as_json="--json" in words))

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of `COMMANDS`."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Make one command."""
        return made(cmd_name, COMMANDS[cmd_name]) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table, without making them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.line) for name, command in COMMANDS.items()])

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Find the command as click does; for an unknown name propose the nearest command."""
        import difflib

        if args and args[0] not in COMMANDS:
            close = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f" Did you mean '{close[0]}'?" if close else ""
            ctx.fail(f"No such command '{args[0]}'.{hint}")
        return super().resolve_command(ctx, args)


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(package_name="taction", prog_name=PROGRAM)
def main() -> None:
    """Design and verify regularising op-amp and resistor networks with SPICE.

    Exit status: 0 pass, 1 a check failed, 2 bad input, 3 no verdict. `taction --json --help` prints
    all commands, options, schemas and exit statuses as one JSON document.
    """
    # ngspice uses the other cores. BLAS threads that wait for a busy core spin: the poles of 64
    # channels took a minute instead of a second. Users with free cores can set the variables.
    for name in THREADS:
        os.environ.setdefault(name, "1")
