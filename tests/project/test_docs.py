"""What the documentation shows is true: commands, examples, links, limits and sizes."""

from __future__ import annotations

import doctest
import importlib
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import taction as library
from scripts.rooms import modules
from taction.cli.main import main
from taction.system import progress as after_result
from taction.verification.report.explorer import server
from tests.support import nightly
from tests.support.paths import ROOT

DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md")))
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.md"))
BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHELL = ("", "sh", "{typed}")  # languages of blocks with commands
DOCUMENT = ["--json", "--help"]  # the document of all commands, which click does not know
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
PROMISES = (DOCS / "promises.md").read_text("utf-8")


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


def test_a_shown_command_can_be_parsed() -> None:
    lines = [(page, words) for page in PAGES for words in shown(page.read_text("utf-8"))]
    assert len(lines) > 35
    for page, line in lines:
        if line == DOCUMENT:
            continue
        command, words, context = command_of(line)
        _, left, _ = command.make_parser(context).parse_args(words)
        most = sum(p.nargs for p in command.params if isinstance(p, click.Argument))
        unlimited = any(p.nargs < 0 for p in command.params) or isinstance(command, click.Group)
        assert unlimited or len(left) <= most, f"{page}: {line}: too many words: {left}"


@pytest.mark.parametrize("page", [*PAGES, *NOTEBOOKS], ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page: Path) -> None:
    text = FENCE.sub("", page.read_text("utf-8"))
    targets = [link.partition("#")[0] for link in LINK.findall(text) if "://" not in link]
    made = ("_generated/", "../.github")  # by the build of the documentation; for readers on GitHub
    files = [name for name in targets if name and not name.startswith(made)]
    assert [name for name in files if not (page.parent / name).exists()] == []


def test_every_limit_is_the_number_of_the_code_and_every_test_exists() -> None:
    limits = re.findall(r"\| (\S+) \|[^|]*\| `([\w.]+)\.([A-Z_]+)` \|", PROMISES)
    assert len(limits) == PROMISES.split("## Limits")[1].split("## Fuzzing")[0].count("\n| ") - 1
    for number, module, name in limits:
        assert float(number) == getattr(importlib.import_module(module), name)
    for file, name in set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PROMISES)):
        assert f"\ndef {name}(" in (ROOT / file).read_text("utf-8"), f"{file} has no {name}"


TOUR = "".join(
    re.findall(r"^```pycon\n(.*?)^```$", (DOCS / "tour.md").read_text("utf-8"), re.M | re.S)
)


def test_every_public_name_is_used() -> None:
    used = set(re.findall(r"\btaction\.(\w+)", TOUR))
    assert used == set(library.__all__)


@pytest.mark.usefixtures("quick_stories")
def test_each_line_gives_what_a_page_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    explored: list[str] = []
    served: list[str] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(server, "explore", lambda scene, **_: explored.append(scene.name))
    monkeypatch.setattr(library, "mcp", served.append)
    shutil.copy(ROOT / "tests" / "data" / "fet100.cir", tmp_path)
    examples = doctest.DocTestParser().get_doctest(TOUR, {}, "tour.md", "tour.md", 0)
    found = doctest.DocTestRunner().run(examples)
    assert found.attempted > 50
    assert not found.failed
    assert explored == ["tour"]
    assert served == ["boards"]


WITH_EXAMPLES = [
    name
    for name, path in modules().items()
    if not name.startswith("door") and ">>> " in path.read_text("utf-8")
]


# Of these the page above uses the function, too.
SLOW = {
    *("verification.design.tune", "verification.evidence.demonstration"),
    "verification.studies.onset",
}


@pytest.mark.parametrize("name", [*sorted({*WITH_EXAMPLES} - SLOW), *nightly(*sorted(SLOW))])
def test_the_examples_of_a_module(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))  # as users have it
    result = doctest.testmod(importlib.import_module(f"taction.{name}"))
    assert result.attempted
    assert not result.failed
