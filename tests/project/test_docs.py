"""What the documentation shows is true: commands, examples, links, limits and sizes."""

from __future__ import annotations

import doctest
import importlib
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

import taction as library
from scripts.rooms import modules
from taction.cli.main import main
from taction.system import progress as after_result
from taction.verification.report import tool_server
from taction.verification.report.explorer import server
from tests.support.paths import ROOT
from tests.support.running import taction

DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md")))
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.md"))
BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHELL = ("", "sh", "{typed}")  # languages of blocks with commands
DOCUMENT = ["--json", "--help"]  # the document of all commands, which click does not know
INLINE = re.compile(r"`taction ([^`]+)`")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
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


def test_the_readme_is_short_and_shows_the_screen_of_its_command() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 90
    (shown,) = re.findall(r"^```\n(PASS: .*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = shown.splitlines()
    printed = taction("verify", str(ROOT / "scenes" / "paper-breadboard.toml")).stdout.splitlines()
    assert len(lines) > 8
    assert [line for line in lines if line not in printed] == []


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
    (bom,) = (line for line in lines if line.startswith("export bom"))
    assert taction(*shlex.split(bom)).exit_code == 0
    assert Path("parts.csv").exists()


PROMISES = (DOCS / "promises.md").read_text("utf-8")


def test_every_limit_is_the_number_of_the_code_and_every_test_exists() -> None:
    limits = re.findall(r"\| (\S+) \|[^|]*\| `([\w.]+)\.([A-Z_]+)` \|", PROMISES)
    assert len(limits) == PROMISES.split("## Limits")[1].split("## Fuzzing")[0].count("\n| ") - 1
    for number, module, name in limits:
        assert float(number) == getattr(importlib.import_module(module), name)
    for file, name in set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PROMISES)):
        assert f"\ndef {name}(" in (ROOT / file).read_text("utf-8"), f"{file} has no {name}"


UNITS = {"mV": 1e-3, "uV": 1e-6, "nV": 1e-9}
SIZES = {  # of what is not modelled
    "leakage": "leakage of the board",
    "hum": "hum and interference",
    "warm-up": "warm-up of the op-amps",
    "resistors": "voltage and self-heating",
    "thermoelectric": "thermoelectric voltages",
    "supply": "supply impedance",
}


def test_the_sizes_are_those_that_the_code_of_the_page_finds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    page = (DOCS / "network.md").read_text("utf-8").partition("## Limits of validity")[2]
    names: dict[str, Any] = {}
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], names)  # noqa: S102
    assert capsys.readouterr().out
    assert names["sizes"].keys() == SIZES.keys()
    for key, title in SIZES.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| {title}"))
        digits, unit = row.split("|")[3].split()
        assert float(digits) * UNITS[unit] == pytest.approx(names["sizes"][key], rel=0.35), key
    before, slower, unstable = names["poles"]
    assert before.real / slower.real == pytest.approx(1.4, abs=0.05)
    assert unstable.real > 0.0
    assert abs(unstable.imag) / 6.2832 == pytest.approx(36e3, rel=0.02)


TOUR = "".join(
    re.findall(r"^```pycon\n(.*?)^```$", (DOCS / "tour.md").read_text("utf-8"), re.M | re.S)
)


def test_every_public_name_is_used() -> None:
    used = set(re.findall(r"\btaction\.(\w+)", TOUR))
    assert used == set(library.__all__)


@pytest.mark.usefixtures("quick_stories")
def test_every_line_gives_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    explored: list[str] = []
    served: list[tuple[str, float]] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(server, "explore", lambda scene, **_: explored.append(scene.name))
    monkeypatch.setattr(tool_server, "serve", lambda folder, limit: served.append((folder, limit)))
    shutil.copy(ROOT / "tests" / "data" / "fet100.cir", tmp_path)
    examples = doctest.DocTestParser().get_doctest(TOUR, {}, "tour.md", "tour.md", 0)
    found = doctest.DocTestRunner().run(examples)
    assert found.attempted > 50
    assert not found.failed
    assert explored == ["tour"]
    assert served == [("boards", 300.0)]


WITH_EXAMPLES = [
    name
    for name, path in modules().items()
    if not name.startswith("door") and ">>> " in path.read_text("utf-8")
]


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_the_examples_of_a_module(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))  # as users have it
    result = doctest.testmod(importlib.import_module(f"taction.{name}"))
    assert result.attempted
    assert not result.failed
