"""The commands that the documentation shows exist, with these options; the quick ones are run."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import taction as library
from taction.cli.main import main
from tests.support.paths import ROOT
from tests.support.running import taction

DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md")))
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.md"))
BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHELL = ("", "sh", "{typed}")  # languages of blocks with commands
DOCUMENT = ["--json", "--help"]  # the document of all commands, which click does not know
CODE = re.compile(r"```\{code-cell\} ipython3\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`taction ([^`]+)`")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"!\[([^\]]*)\]|^:alt: (.*)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def shown(text: str) -> Iterator[list[str]]:
    """The words of every command `taction ...` in the code blocks of a page."""
    blocks = [block for language, block in BLOCK.findall(text) if language in SHELL]
    for block in blocks:
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("taction "):
                words = shlex.split(line.partition(" | ")[0], comments=True)
                yield words[1 : words.index(">")] if ">" in words else words[1:]


def command_of(words: list[str]) -> tuple[click.Command, list[str], click.Context]:
    """The command that `words` begin with, and the words behind its name."""
    command: click.Command = main
    # With the group's settings: click keeps the command's -h for the tests that follow.
    context = click.Context(main, info_name="taction", **main.context_settings)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(context, words[0])
        assert found is not None, f"no command {words[0]!r}"
        command, words = found, words[1:]
        context = click.Context(command, info_name=command.name, parent=context)
    return command, words, context


def commands() -> list[tuple[str, str]]:
    pages = ((page.name, page.read_text("utf-8")) for page in PAGES)
    return [
        (name, shlex.join(words))
        for name, text in pages
        for words in shown(text)
        if words != DOCUMENT
    ]


def test_there_are_commands_in_the_pages() -> None:
    assert len(commands()) > 35
    assert len(NOTEBOOKS) == 4


@pytest.mark.parametrize(("page", "line"), commands())
def test_a_shown_command_can_be_parsed(page: str, line: str) -> None:
    command, words, context = command_of(shlex.split(line))
    _, left, _ = command.make_parser(context).parse_args(words)
    most = sum(p.nargs for p in command.params if isinstance(p, click.Argument))
    unlimited = any(p.nargs < 0 for p in command.params)
    group = isinstance(command, click.Group)
    assert group or unlimited or len(left) <= most, f"{page}: {line}: too many words: {left}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_and_option_in_a_sentence_exists(page: Path) -> None:
    for line in INLINE.findall(FENCE.sub("", page.read_text("utf-8"))):
        words = line.split()
        if words == DOCUMENT or not re.fullmatch(r"[a-z-]+", words[0]):
            continue
        command, rest, _ = command_of(words)
        known = {name for param in command.params for name in param.opts + param.secondary_opts}
        known |= {"--help", *(name for param in main.params for name in param.opts)}
        used = {word.partition("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
        assert used <= known, f"{page.name}: taction {line}"


@pytest.mark.parametrize("page", [*PAGES, *NOTEBOOKS], ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page: Path) -> None:
    text = FENCE.sub("", page.read_text("utf-8"))
    targets = [link.partition("#")[0] for link in LINK.findall(text) if "://" not in link]
    made = ("_generated/", "../.github")  # by the build of the documentation; for readers on GitHub
    files = [name for name in targets if name and not name.startswith(made)]
    assert [name for name in files if not (page.parent / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_picture_has_a_sentence_that_says_what_it_shows(page: Path) -> None:
    texts = [a or b for a, b in PICTURE.findall(page.read_text("utf-8"))]
    assert [text for text in texts if len(text.split()) < 5] == []


@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_a_notebook_has_cells_that_compile_and_lines_that_fit(page: Path) -> None:
    text = page.read_text("utf-8")
    cells = CODE.findall(text)
    assert text.startswith("---\nfile_format: mystnb\n")
    assert len(cells) > 5
    for cell in cells:
        compile(cell, page.name, "exec")
        assert max(map(len, cell.splitlines())) <= 88


def test_notebooks_are_written_for_jupyter_without_outputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("myst_nb")
    monkeypatch.setattr(sys, "path", [str(DOCS), *sys.path])
    import generated

    generated.write_notebooks(tmp_path)
    for page in NOTEBOOKS:
        notebook = nbformat.read(tmp_path / f"{page.stem}.ipynb", as_version=4)
        code = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert [cell.source for cell in code] == [c.strip() for c in CODE.findall(page.read_text())]
        assert all(not cell.outputs and cell.execution_count is None for cell in code)
        prose = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
        assert not [link for link in LINK.findall(prose) if not link.endswith(".ipynb")]


def test_the_tutorial_can_be_typed_in_a_fresh_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its scene, the verdicts that it promises, and the parts list."""
    text = (DOCS / "tutorial.md").read_text("utf-8")
    (included,) = re.findall(r"\{literalinclude\} (\S+)", text)
    monkeypatch.chdir(tmp_path)
    Path("board.toml").write_text((DOCS / included).read_text("utf-8"), encoding="utf-8")
    lines = [shlex.join(words) for words in shown(text)]
    assert lines[0] == "verify board.toml"
    first = taction(*shlex.split(lines[1]), "--engine", "statespace")
    assert first.exit_code == 0
    assert "2.42 ms" in first.stdout
    assert Path("board.png").exists()
    edits = re.findall(
        r"^sed -e 's/\^(.*)/(.*)/' -e '/\^(.*)/d' board\.toml > (\w+\.toml)", text, re.MULTILINE
    )
    assert len(edits) == 2
    scene = Path("board.toml").read_text("utf-8")
    for old, new, left_out, name in edits:
        assert scene.count(f"\n{old}") == scene.count(f"\n{left_out}") == 1
        kept = [line for line in scene.splitlines() if not line.startswith(left_out)]
        Path(name).write_text("\n".join(kept).replace(f"\n{old}", f"\n{new}"), encoding="utf-8")
    assert "verify small.toml" in lines
    second = library.verify("small.toml", engine="statespace")  # the command also seeks remedies
    assert second.outcome.value == "fail"
    assert re.search(r"oscillates at 3[78]\.?\d* kHz", str(second))
    assert (
        taction(
            *shlex.split(next(line for line in lines if line.startswith("export bom")))
        ).exit_code
        == 0
    )
    assert Path("parts.csv").exists()
