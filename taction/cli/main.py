"""The command ``taction``: the group of all commands, which are made when they are called.

``taction --json --help`` prints every command as one document, as click describes it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import click

from taction.cli.command import made
from taction.cli.commands import COMMANDS
from taction.cli.ending import run_command
from taction.cli.printing import print_json
from taction.system.errors import nearest_question
from taction.system.foreign_files import visible
from taction.system.processes import THREADS

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
    "netlist --split": "In Python: taction.write_deck(circuit, analysis, matrix_file=NAME).",
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
