"""``taction kicad``: one channel of a board as a KiCad project, with the parts of the board."""

from __future__ import annotations

from pathlib import Path

import click

from taction.cli.common import print_json, scene_command
from taction.system.errors import Complaint, InputError

TABLE = "sym-lib-table"  # a name that KiCad prescribes for every project


@scene_command
@click.option(
    "-o", "output", metavar="FOLDER", type=click.Path(file_okay=False), required=True,
    help="Folder of the project; files of the same names are replaced.",
)  # fmt: skip
@click.option("--channel", metavar="N", type=int, default=1, help="Channel to draw, from 1.")
def kicad(scene: str, output: str, channel: int, as_json: bool) -> None:
    """Draw one channel of SCENE for KiCad 8 or newer, and list the parts of the board.

    FOLDER gets a schematic with its symbols, a project file, and the parts of the whole board as
    CSV. References are the names in the deck.
    """
    from taction.netlist_gen.board.synthesis import synthesise
    from taction.netlist_gen.kicad.project import kicad_project
    from taction.system.atomic_files import write_together
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.report.output_checks import check_separate

    read = read_scene(scene)
    project = kicad_project(synthesise(read), read, channel)
    place = Path(output)
    written = {place / name: text for name, text in project.files.items()}
    _check_table(place / TABLE, project.files[TABLE])
    check_separate([scene], {f"-o {output} ({file.name})": str(file) for file in written})
    _make(place)
    write_together(written)
    for file in written:
        click.echo(f"wrote {file}", err=True)
    for what in project.not_drawn:
        click.echo(f"not drawn: {what}", err=True)
    if as_json:
        print_json(
            {
                "scene": read.name,
                "files": [str(file) for file in written],
                "channel": project.channel,
                "row": project.row,
                "not_drawn": list(project.not_drawn),
            }
        )


def _check_table(file: Path, text: str) -> None:
    """Refuse the folder of another project, whose table of symbols would be lost."""
    if file.exists() and file.read_bytes() != text.encode():
        reason = f"the folder has a {TABLE} of another project; give another folder"
        raise InputError("-o", Complaint("FOLDER", repr(str(file.parent)), reason))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"cannot be made: {error.strerror}"
        raise InputError("-o", Complaint("FOLDER", repr(str(folder)), reason)) from None
