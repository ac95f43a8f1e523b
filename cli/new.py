"""``taction new``: a commented scene, or the JSON schema of scene files."""

from __future__ import annotations

from pathlib import Path

import click

from cli.common import command, print_json
from spice_models.atomic_files import write_atomically
from spice_models.errors import Complaint, InputError


@command
@click.argument("file", type=click.Path(dir_okay=False), default="scene.toml")
@click.option("--force", is_flag=True, help="Overwrite FILE.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of scene files instead.")
def new(file: str, force: bool, schema: bool, as_json: bool) -> None:
    """Write a scene to FILE (scene.toml): every key with its default and a comment."""
    if schema:
        from netlist_gen.scene.scene import Scene

        print_json(Scene.model_json_schema(by_alias=True))
        return
    path = Path(file)
    if path.exists() and not force:
        text = "the file exists; give another name, or --force to overwrite it"
        raise InputError(path, Complaint("FILE", "", text))
    template = Path(__file__).with_name("scene_template.toml").read_text(encoding="utf-8")
    stem = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in path.stem)
    write_atomically(path, template.replace("@NAME@", stem[:64] or "scene"))
    if as_json:
        print_json({"file": str(path)})
    click.echo(f"wrote {path}; `taction verify {path}` verifies it", err=True)
