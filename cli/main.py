"""The command ``taction``: a group that loads a command's module only when it is called."""

from __future__ import annotations

import importlib
import os
from typing import Any

import click

from verification.studies.running.threads import THREADS

# name: (module of this package that holds the command, one line for --help); loading none of the
# modules keeps start-up short
COMMANDS: dict[str, tuple[str, str]] = {
    "verify": ("verify", "Netlist, transient, measurements, reference, verdict."),
    "netlist": ("netlist", "Write the ngspice deck of a scene."),
    "solve": ("solve", "The reference solution alone, with its certificate."),
    "simulate": ("simulate", "Waveforms and measurements of a scene."),
    "montecarlo": ("montecarlo", "Yield under component tolerances."),
    "corners": ("montecarlo", "Worst cases within the tolerances."),
    "tune": ("tune", "Gain for least settling time under an overshoot limit."),
    "onset": ("onset", "Every stability crossing over a range, confirmed."),
    "sweep": ("sweep", "A grid of verifications; resumable, local or on a cluster."),
    "regress": ("regress", "A folder of scenes against a stored baseline, for CI."),
    "accuracy": ("accuracy", "Error against run time over engines and methods."),
    "reproduce": ("reproduce", "The paper, claim by claim, figure by figure."),
    "models": ("doctor", "The op-amp presets and their figures."),
    "new": ("new", "Write a commented scene file."),
    "doctor": ("doctor", "What is installed, and what that means."),
}


class LazyGroup(click.Group):
    """A click group whose commands are imported when they are used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of `COMMANDS`."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"{__package__}.{COMMANDS[cmd_name][0]}")
        command: click.Command = getattr(module, cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """As click, with the nearest command's name where there is none of that name."""
        import difflib

        if args and args[0] not in COMMANDS:
            close = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f" Did you mean '{close[0]}'?" if close else ""
            ctx.fail(f"No such command '{args[0]}'.{hint}")
        return super().resolve_command(ctx, args)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="taction", prog_name="taction")
def main() -> None:
    """SPICE netlists and verification of regularising op-amp and resistor networks.

    Exit status: 0 pass, 1 a check failed, 2 bad input, 3 no verdict could be reached.
    """
    # ngspice has the other cores. BLAS threads that wait for a busy core spin: the poles of 64
    # channels took a minute instead of a second. Who has cores to spare sets the variable.
    for name in THREADS:
        os.environ.setdefault(name, "1")
