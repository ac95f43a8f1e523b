"""Files that a command writes: whole, never an input; what a full disk and a gone reader leave."""

from __future__ import annotations

import io
import resource
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import pytest

from taction.cli.main import main
from tests.support.command_lines import PINS, VENDOR, commands
from tests.support.paths import SCENES
from tests.support.running import document, taction

GRID = ("--over", "C=1pF,2pF", "--jobs", "1")
DESIGNS = ("--opamps", "ua741", "--points", "3", "--jobs", "1")
CORNER = ("--corner", "resistor=1")
DRAWN = ("-n", "3", "--jobs", "1")

TABLE = ("--baseline", "b.json", "--jobs", "1")
PICTURES = {"--plot": "x.svg", "--report": "x.html"}

# Name of the command, words, and every output with its file.
LINES: tuple[tuple[str, tuple[str, ...], dict[str, str]], ...] = (
    ("verify", ("a.toml",), PICTURES),
    ("verify", ("a.toml",), {"--junit": "x.xml"}),
    ("check", ("filter.cir",), PICTURES),
    ("diff", ("filter.cir", "filter.cir"), PICTURES),
    ("netlist", ("a.toml",), {"-o": "x.cir"}),
    ("bom", ("a.toml",), {"-o": "x.csv"}),
    ("build", ("a.toml",), {"-o": "x"}),
    ("simulate", ("a.toml",), {"-o": "x.csv"}),
    ("montecarlo", ("a.toml", *DRAWN), {**PICTURES, "-o": "x.sqlite"}),
    ("corners", ("a.toml", *CORNER), {"--report": "x.html"}),
    ("tune", ("a.toml",), {**PICTURES, "-o": "x.toml"}),
    ("choose", ("a.toml", *DESIGNS), {**PICTURES, "-o": "x", "--store": "x.sqlite"}),
    ("scale", ("a.toml",), {"-o": "x.toml"}),
    ("onset", ("a.toml", "--over", "C=8pF:9pF:3", "--no-confirm"), PICTURES),
    ("sweep", ("a.toml", *GRID), {**PICTURES, "-o": "x.sqlite", "--export": "x.csv"}),
    ("regress", (".", *TABLE), {"--junit": "x.xml", "--markdown": "x.md", "--report": "x.html"}),
    ("stress", ("--only", "one-channel", "--jobs", "1"), {"--report": "x.html"}),
    ("accuracy", ("a.toml",), PICTURES),
    ("reproduce", (), {"--report": "x.html"}),
    ("demo", (), {"-o": "x.html", "--plot": "x.png"}),
    ("models show", ("ua741",), {"--plot": "x.svg"}),
    ("models import", ("v.cir", *PINS.split()), {"-o": "x.json"}),
    ("new", (), {"FILE": "x.toml"}),
)
SLOW = ("accuracy", "choose", "tune", "onset", "demo", "stress", "reproduce")  # write as others do
SINGLE = [
    (name, words, option, file) for name, words, files in LINES for option, file in files.items()
]
ENDS = {  # of a whole file
    ".svg": b"</svg>", ".html": b"</html>", ".xml": b"</testsuites>", ".cir": b".end",
    ".json": b"}", ".sqlite": b"",
}  # fmt: skip

SCENE = str(SCENES / "tuned-breadboard.toml")
OVER = ("--over", "C=50p:500p:12", "--jobs", "1")
SWEEP = ("sweep", SCENE, *OVER, "--engine", "statespace", "--json", "-o")


class ReaderGone(io.TextIOBase):
    """A stream whose reader has gone; like a pipe, it fails at the first text."""

    def write(self, text: str) -> int:
        raise BrokenPipeError


@pytest.fixture
def folder(boards: Path, quick_stories: None) -> Path:
    shutil.copy(VENDOR, boards / "v.cir")
    return boards


def test_every_path_is_an_input_or_an_output_and_every_output_is_listed() -> None:
    outputs = {(name, p.option) for name, each in commands() for p in each.every if p.writes}
    short = {"--output": "-o"}
    assert {(name, option) for name, _, option, _ in SINGLE} == {
        (name, short.get(option, option)) for name, option in outputs
    }
    for name, command in commands():
        for each in command.every:
            kind, metavar = each.attributes.get("type"), each.attributes.get("metavar")
            if isinstance(kind, click.Path) or metavar == "FILE":
                assert each.reads or each.writes, (name, each.name)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(  # text and documents leave by the same two lines: each command has one
    ("name", "words", "files", "mode"),
    [(*e, ("--json",) * (k % 2)) for k, e in enumerate(LINES) if e[0] not in SLOW],
)
def test_files_are_whole_although_the_reader_has_gone(
    name: str,
    words: tuple[str, ...],
    files: dict[str, str],
    mode: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    ngspice: str,
) -> None:
    places = [word for option, file in files.items() for word in (option, file) if word != "FILE"]
    monkeypatch.setattr(sys, "stdout", ReaderGone())
    with pytest.raises(SystemExit) as end:
        main([*name.split(), *words, *places, *mode])
    silent = name in ("new", "netlist") and not mode  # nothing on stdout
    assert end.value.code == (0 if silent else 141)
    for made in map(Path, files.values()):
        parts = [p for p in made.rglob("*") if p.is_file()] if made.is_dir() else [made]
        assert parts
        for part in parts:
            assert part.stat().st_size > 80
            assert part.read_bytes().rstrip().endswith(ENDS.get(part.suffix, b""))


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("name", "words", "option", "file"), [e for e in SINGLE if e[3] != "x"])
def test_a_missing_folder_is_named_before_any_work(
    name: str, words: tuple[str, ...], option: str, file: str
) -> None:
    there = f"missing/{file}"
    result = taction(*name.split(), *words, *((there,) if option == "FILE" else (option, there)))
    assert result.exit_code == 2
    assert f"{option}: FILE = '{there}': its folder does not exist" in result.stderr
    assert result.stdout == ""


# Every output at the place of each input of the same command, written in another way.
TWICE = [
    (name, words, option, f"./{word}")
    for name, words, option, file in SINGLE
    if file != "x"
    for word in words
    if word.endswith((".toml", ".cir", "b.json"))
]
TWICE += [
    ("new", ("--matrix", "T.csv", "--strain", "eps.csv", "--force"), "FILE", "T.csv"),
    ("verify", ("a.toml", "slow.toml"), "--junit", "slow.toml"),
    ("netlist", ("matrix.toml",), "-o", "T.csv"),
    ("netlist", ("a.toml",), "-o", "link.toml"),
    ("regress", (".", *TABLE), "--junit", "a.toml"),
    ("regress", (".", *TABLE, "--markdown", "x"), "--junit", "x"),  # two outputs, one file
]


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize(("name", "words", "option", "file"), TWICE)
def test_an_input_is_never_overwritten(
    folder: Path, name: str, words: tuple[str, ...], option: str, file: str
) -> None:
    problem = 'problem = { kind = "matrix", matrix = "T.csv", strain = "eps.csv" }\n'
    (folder / "matrix.toml").write_text(problem)
    (folder / "link.toml").symlink_to("a.toml")
    before = contents(folder)
    result = taction(*name.split(), *words, *((file,) if option == "FILE" else (option, file)))
    assert result.exit_code == 2
    says = ("an input of the same command; expected another", "a file that ends in", "file of --")
    assert any(each in result.stderr for each in says)
    assert contents(folder) == before


@contextmanager
def no_file_above(limit: int) -> Iterator[None]:
    """Let the system refuse every byte of a file beyond `limit`."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = bytecode


def test_a_sweep_goes_on_with_room(tmp_path: Path) -> None:
    words = (*SWEEP, str(tmp_path / "a.sqlite"))
    with no_file_above(60_000):
        full = taction(*words)
    assert full.exit_code == 3, full.stderr
    assert document(full)["error"]["kind"] == "OutOfDisk"
    assert "make room on the disk and run the same command again" in full.stderr
    again = taction(*words)
    assert again.exit_code == 0, again.stderr
    assert document(again)["done"] == 12


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.csv"),
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.raw"),
        (("verify", SCENE, "--engine", "statespace", "--plot"), "a.svg"),
        (("netlist", SCENE, "-o"), "a.cir"),
        (("new", "--force"), "a.toml"),
    ],
)
def test_an_output_is_whole_or_unchanged(words: tuple[str, ...], name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("old")
    with no_file_above(500):
        done = taction(*words, str(tmp_path / name))
    assert done.exit_code == 2, done.stderr
    assert f"{name}: FILE: File too large; expected a file" in done.stderr
    assert "Traceback" not in done.stderr
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: "old"}
