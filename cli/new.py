"""``taction new``: a commented scene, a scene for a matrix, or the JSON schema of scene files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from taction.cli.common import STATUS, command, output_option, print_json, stage_display
from taction.system.atomic_files import write_atomically
from taction.system.errors import Complaint, InputError


@command
@click.argument("target", metavar="[FILE]", type=click.Path(dir_okay=False), required=False)
@output_option("The same as FILE.")
@click.option("--force", is_flag=True, help="Overwrite FILE.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of scene files instead.")
@click.option(
    "--matrix", metavar="T", help="Matrix T, .csv or .npy: a scene for it, with --strain."
)
@click.option("--strain", metavar="EPS", help="Strain of the matrix, .csv or .npy.")
@click.option(
    "--noise",
    type=click.FloatRange(0, min_open=True),
    help="Standard deviation of the noise of one strain: lambda by the discrepancy rule.",
)
@click.option(
    "--lambda",
    "lam",
    type=click.FloatRange(0, min_open=True),
    help="Lambda; by default 0.01 times the squared norm of T, or by --noise.",
)
@click.option("--opamp", default="tl084", metavar="NAME", help="Preset, with --matrix.")
@click.option("--supply", metavar="VOLTS", help="Supply as ±12V, with --matrix.")
@click.option("--prune", type=click.FloatRange(0, 1, max_open=True), help="design.prune.")
def new(
    target: str | None, output: str | None, force: bool, schema: bool, as_json: bool, **asked: Any
) -> None:
    """Write a scene to FILE (scene.toml): every key with its default and a comment.

    With --matrix and --strain: a scene for them, scaled for the op-amps, stable, and verified by
    the state-space engine, which decides the exit status.
    """
    if schema:
        from taction.netlist_gen.scene.scene import scene_type

        print_json(scene_type().model_json_schema(by_alias=True), "")
        return
    path = Path(target or output or "scene.toml")
    _check(path, target, output, force, asked)
    if asked["matrix"] is not None:
        _for_matrix(path, force, as_json, asked)
        return
    template = Path(__file__).with_name("scene_template.toml").read_text(encoding="utf-8")
    stem = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in path.stem)
    write_atomically(path, template.replace("@NAME@", stem[:64] or "scene"))
    click.echo(f"wrote {path}; `taction verify {path}` verifies it", err=True)
    if as_json:
        print_json({"file": str(path)})


def _check(
    path: Path, target: str | None, output: str | None, force: bool, asked: dict[str, Any]
) -> None:
    if target is not None and output is not None:
        raise InputError("-o", Complaint("FILE", repr(output), "give FILE or -o, not both"))
    if (asked["matrix"] is None) != (asked["strain"] is None):
        missing = "--matrix" if asked["matrix"] is None else "--strain"
        raise InputError(missing, Complaint("FILE", "", "--matrix and --strain belong together"))
    for name in ("noise", "lam", "supply", "prune"):
        if asked["matrix"] is None and asked[name] is not None:
            option = "--lambda" if name == "lam" else f"--{name}"
            raise InputError(option, Complaint("value", repr(asked[name]), "needs --matrix"))
    _refuse_existing(path, force)


def _refuse_existing(path: Path, force: bool) -> None:
    if path.exists() and not force:
        text = "the file exists; give another name, or --force to overwrite it"
        raise InputError(path, Complaint("FILE", "", text))


def _for_matrix(path: Path, force: bool, as_json: bool, asked: dict[str, Any]) -> None:
    from taction.cli.scale import scaling_document, show_scaling
    from taction.netlist_gen.scene.file import load_scene
    from taction.verification.design.fresh_scene import fresh_scene
    from taction.verification.verdict.verify import verify

    design = {"opamp": asked["opamp"], "supply": asked["supply"], "prune": asked["prune"]}
    with stage_display() as progress:
        progress("scalings")
        fresh = fresh_scene(
            Path(asked["matrix"]),
            Path(asked["strain"]),
            path,
            noise=asked["noise"],
            lam=asked["lam"],
            design={key: value for key, value in design.items() if value is not None},
        )
        for name in fresh.files:
            _refuse_existing(name, force)
        for name, text in (*fresh.files.items(), (path, fresh.text)):
            write_atomically(name, text)
        verdict = verify(load_scene(path).with_engine("statespace"), progress)
    for name in (*fresh.files, path):
        click.echo(f"wrote {name}", err=True)
    if as_json:
        more = {"file": str(path), "lambda_rule": fresh.rule, "recognised": list(fresh.notes)}
        print_json(more | scaling_document(fresh.scaling, verdict), "new-matrix")
    else:
        for note in fresh.notes:
            click.echo(note)
        click.echo(f"lambda {fresh.rule}")
        show_scaling(fresh.scaling, verdict)
    sys.exit(STATUS[verdict.outcome.value])
