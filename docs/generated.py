"""Pages that the build makes: keys of a scene from its schema, commands from click, pictures.

Everything here comes from the code or from a real run, so it cannot become out of date.
"""

from __future__ import annotations

import contextlib
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import matplotlib as mpl
import numpy as np
from click.testing import CliRunner
from matplotlib.figure import Figure

import taction

HERE = Path(__file__).resolve().parent
ROOT, PLACE = HERE.parent, HERE / "_generated"
PAGE_LINK = re.compile(r"\[([^\]]+)\]\(\.\./([\w-]+)\.md(?:#[\w-]+)?\)")
NOTEBOOK_LINK = re.compile(r"(?<=\])\(([\w-]+)\.md\)")
SPACE = "--engine statespace"
PICTURES = {  # name and command line by title
    "The paper's board: it passes, and it rings for 2.4 ms":
        ("breadboard", f"verify scenes/paper-breadboard.toml {SPACE}"),
    "A damped board: it settles after its first rise":
        ("tuned", f"verify scenes/tuned-breadboard.toml {SPACE}"),
    "Exponential amplifiers: the outputs are positive":
        ("exponential", f"verify scenes/paper-exponential.toml {SPACE}"),
    "Poles and crossings over C: the board oscillates below 9.02 pF":
        ("onset", "onset scenes/paper-breadboard.toml --over C --no-confirm"),
    "Settling time: the last instant outside the band":
        ("settling", f"verify scenes/known-readings.toml {SPACE}"),
    "Margin: the rightmost pole over C, positive where the board oscillates":
        ("margin", "onset scenes/tuned-breadboard.toml --over C=2pF:20pF:31 --no-confirm"),
    "A closed-loop board over gf: it has a least value, and a fastest one a little above":
        ("feedback-conductance", "onset scenes/least-squares.toml"
         " --over feedback_conductance=100uS:10mS:41 --no-confirm"),
    "A yield: resistors of 1 % do not hold a steady state within 0.1 %":
        ("yield", "montecarlo scenes/tuned-breadboard.toml -n 60 --jobs 1"),
    "An op-amp's open loop as its data sheet states it": ("opamp", "models show ua741"),
    "A sweep over C and gain: which check fails, and the boundary of oscillation":
        ("map", "sweep scenes/tuned-breadboard.toml --over C=1pF:100pF:9 --over gain=1M:20M:7"
         f" --fix lambda {SPACE} --jobs 1"),
}  # fmt: skip


def write_pages(app: object = None) -> None:
    """Write all pages and pictures into `PLACE`."""
    PLACE.mkdir(exist_ok=True)
    _write("scene.md", "\n".join(_scene_page()))
    _write("commands.md", "\n".join(_commands_page()))
    _write("json.md", "\n".join(_json_page()))
    _write("gallery.md", "\n".join(_gallery_page()))
    draw_pictures()
    write_notebooks(PLACE / "notebooks")


def write_notebooks(folder: Path) -> None:
    """Write the lessons as notebooks for Jupyter, without outputs, into `folder`."""
    import nbformat
    from myst_nb.core.read import read_myst_markdown_notebook

    folder.mkdir(parents=True, exist_ok=True)
    for page in sorted((HERE / "notebooks").glob("*.md")):
        text = PAGE_LINK.sub(r"\1 (docs/\2.md)", page.read_text("utf-8"))
        notebook = read_myst_markdown_notebook(NOTEBOOK_LINK.sub(r"(\1.ipynb)", text))
        nbformat.validate(notebook)
        nbformat.write(notebook, folder / f"{page.stem}.ipynb")


def write_schemas() -> None:
    """Write the schema of scenes, and those of all documents; one that is none any more goes."""
    from taction.netlist_gen.scene.scene import scene_schema
    from taction.verification.report.documents.document_catalogue import schemas

    scenes = json.dumps(scene_schema(), indent=2, ensure_ascii=False)
    (HERE / "scene.schema.json").write_text(f"{scenes}\n", encoding="utf-8")
    texts = dict(schemas())
    for name, text in texts.items():
        (HERE / "schemas" / name).write_text(text, encoding="utf-8")
    for path in (HERE / "schemas").glob("*.json"):
        if path.name not in texts:
            path.unlink()


def draw_pictures() -> None:
    """Draw what lambda does, as SVG that is always the same."""
    with mpl.rc_context({"svg.hashsalt": "taction"}):
        _regularisation().savefig(PLACE / "lambda.svg", metadata={"Date": None})


def _regularisation() -> Figure:
    """Return the answers of one noisy problem with three values of lambda."""
    place = np.arange(25)
    T = np.exp(-((place[:, None] - place[None, :]) ** 2) / 8.0)
    u = np.where((place > 6) & (place < 12), 1.0, 0.0)
    eps = T @ u + np.random.default_rng(3).normal(0.0, 0.1, len(u))
    figure = Figure((6.4, 3.4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(place, u, color="#808080", lw=5, alpha=0.5, label="true u")
    for lam, colour, line in ((1e-3, "#d55e00", ":"), (0.3, "#0072b2", "-"), (100.0, "k", "--")):
        answer = taction.solve(taction.Scene.from_arrays(T, eps, lam=lam, name="lambda")).u
        axes.plot(place, answer, line, color=colour, label=f"lambda = {lam:g}")
    axes.set(xlabel="channel", ylabel="u", ylim=(-1.2, 2.2))
    axes.legend(frameon=False, fontsize=9, ncols=2)
    return figure


def _write(name: str, text: str) -> None:
    path = PLACE / name
    if not path.exists() or path.read_text("utf-8") != text:  # an unchanged page is not built anew
        path.write_text(text, "utf-8")


def _scene_page() -> Iterator[str]:
    schema = json.loads((HERE / "scene.schema.json").read_text("utf-8"))
    yield "# Keys of a scene file\n"
    yield 'A scene is a TOML file. Every quantity is a number in SI units or a text such as `"10pF"`.'
    yield "Unknown keys are refused, with the nearest known key. `scene.schema.json` beside this page"
    yield "lets an editor complete and check scene files.\n"
    yield from _section("", schema, schema["$defs"], 1)


def _section(path: str, schema: dict[str, Any], kinds: dict[str, Any], level: int) -> Iterator[str]:
    """Yield the table of the keys of a table, then the tables below it."""
    below = []
    if path:
        yield f"\n{'#' * min(level, 5)} `{path}`\n"
        if schema.get("description"):
            yield f"{_plain(schema['description'])}\n"
    rows = []
    for key, about in schema.get("properties", {}).items():
        about = {**_resolved(about, kinds), **{k: v for k, v in about.items() if k != "$ref"}}
        own = f"{path}.{key}" if path else key
        tables = [choice for choice in _choices(about, kinds) if "properties" in choice]
        below += [(own, table) for table in tables]
        rows.append(
            f"| `{key}` | {_type(about, kinds)} | {_default(about)} | {_plain(about.get('description', ''))} |"
        )
    if rows:
        yield "| key | value | default | meaning |"
        yield "|---|---|---|---|"
        yield from rows
        yield ""
    for own, table in below:
        constant = table["properties"].get("kind", {}).get("const")
        name = f'{own}` with `kind = "{constant}"' if constant else own
        for line in _section(own, table, kinds, level + 1):
            yield line.replace(f"`{own}`", f"`{name}`", 1) if line.startswith("\n#") else line


def _resolved(about: dict[str, Any], kinds: dict[str, Any]) -> dict[str, Any]:
    reference = about.get("$ref", "").rpartition("/")[2]
    found: dict[str, Any] = kinds[reference] if reference else about
    return found


def _choices(about: dict[str, Any], kinds: dict[str, Any]) -> list[dict[str, Any]]:
    several = about.get("oneOf") or about.get("anyOf") or [about]
    return [_resolved(choice, kinds) for choice in several]


def _type(about: dict[str, Any], kinds: dict[str, Any]) -> str:
    words: list[str] = []
    for choice in _choices(about, kinds):
        if "const" in choice:
            word = f"`{json.dumps(choice['const'])}`"
        elif "enum" in choice:
            word = ", ".join(f"`{json.dumps(value)}`" for value in choice["enum"])
        elif "properties" in choice:
            word = "table"
        else:
            kinds_of = choice.get("type", "")
            kinds_of = kinds_of if isinstance(kinds_of, list) else [kinds_of]
            names = {"null": "", "number": "number", "string": "text"}
            word = " or ".join(name for kind in kinds_of if (name := names.get(kind, kind)))
            limits = [
                f"{sign} {choice[name]:g}"
                for name, sign in (
                    ("gt", "above"), ("ge", "from"), ("lt", "below"), ("le", "to"),
                    ("exclusiveMinimum", "above"), ("minimum", "from"),
                    ("exclusiveMaximum", "below"), ("maximum", "to"),
                )
                if isinstance(choice.get(name), (int, float))
            ]  # fmt: skip
            word = " ".join([word, *limits]) if word else ""
        if word and word not in words:
            words.append(word)
    return " or ".join(words).replace("|", "\\|") or "-"


def _default(about: dict[str, Any]) -> str:
    if "default" not in about or isinstance(about["default"], dict):
        return "-"
    return "none" if about["default"] is None else f"`{json.dumps(about['default'])}`"


def _plain(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def _commands_page() -> Iterator[str]:
    from taction.cli.commands import COMMANDS
    from taction.cli.main import main

    yield "# Commands\n"
    yield "`taction COMMAND --help` prints what is below. Exit status: 0 pass, 1 a check failed, 2 bad"
    yield "input, 3 no verdict; 130, 143 and 129 after SIGINT, SIGTERM and SIGHUP; 141 for a closed pipe.\n"
    with click.Context(main, info_name="taction") as context:
        for name in COMMANDS:
            command = main.get_command(context, name)
            if command is None:
                continue
            yield from _command(command, f"taction {name}", context)


def _command(command: click.Command, name: str, above: click.Context) -> Iterator[str]:
    with click.Context(command, info_name=name.partition(" ")[2], parent=above) as context:
        yield f"\n## `{name}`\n"
        yield f"```text\n{command.get_help(context)}\n```"
        if isinstance(command, click.Group):
            for below in command.list_commands(context):
                inner = command.get_command(context, below)
                if inner is not None:
                    yield from _command(inner, f"{name} {below}", context)


def _json_page() -> Iterator[str]:
    yield "# JSON documents\n"
    yield "With `--json` every command prints one document. Each has a versioned schema; the tables below are made"
    yield "from them, and a test compares real documents with them. Values are in SI base units; null is unknown.\n"
    for file in sorted((HERE / "schemas").glob("*.json")):
        schema = json.loads(file.read_text("utf-8"))
        kinds = schema.get("$defs", {})
        yield f"\n## `{file.stem}`\n"
        about = _plain(schema.get("description", "")).replace("``", "`")
        yield f"{about} The schema: {{download}}`{file.name} <../schemas/{file.name}>`\n"
        rows = [(name, _field(each, kinds)) for name, each in schema.get("properties", {}).items()]
        if rows:
            yield "| field | value | meaning |"
            yield "|---|---|---|"
            yield from (f"| `{name}` | {' | '.join(cells)} |" for name, cells in rows)


def _field(about: dict[str, Any], kinds: dict[str, Any]) -> tuple[str, str]:
    """Return the type of a field of a document, and what it means."""
    unit = f", {about['unit']}" if "unit" in about else ""
    resolved = {**_resolved(about, kinds), **{k: v for k, v in about.items() if k != "$ref"}}
    return f"{_type(resolved, kinds)}{unit}", _plain(resolved.get("description", ""))


def _gallery_page() -> Iterator[str]:
    from taction.cli.main import main

    yield "# Gallery\n"
    yield "The build of this documentation draws these pictures, by the commands below them.\n"
    for title, (name, line) in PICTURES.items():
        picture, shown = PLACE / f"{name}.png", line.removesuffix(" --jobs 1")
        more = ["-o", str(PLACE / f"{name}.sqlite")] if line.startswith("sweep") else []
        picture.unlink(missing_ok=True)
        with contextlib.chdir(ROOT):  # in this process: a start is as long as a picture
            done = CliRunner().invoke(main, [*line.split(), *more, "--plot", str(picture)])
        if not picture.exists():
            raise RuntimeError(f"{shown}: no picture: {done.output}")
        yield f"## {title}\n\n![{title}]({picture.name})\n\n```sh\ntaction {shown} --plot {name}.png\n```\n"


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_pages)
    app.connect("build-finished", lambda app, error: _publish(Path(app.outdir)))
    return {"parallel_read_safe": True}


def _publish(out: Path) -> None:
    for schema in HERE.glob("*.schema.json"):
        shutil.copy(schema, out)
