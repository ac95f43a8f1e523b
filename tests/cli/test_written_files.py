"""Files that a command writes: whole although the reader of stdout has gone, never an input."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import pytest

from taction.cli.command import Command
from taction.cli.main import COMMANDS, main
from taction.verification.evidence.paper import reproduce
from tests.support.entries import write_fast
from tests.support.paths import ROOT
from tests.support.running import taction

VENDOR = ROOT / "tests" / "data" / "fet100.cir"
PINS = ("--subckt", "FET100", "--pins", "inp,inn,vcc,vee,out")
GRID = ("--over", "C=1pF,2pF", "--jobs", "1")
DESIGNS = ("--opamps", "ua741", "--points", "3", "--jobs", "1")
CORNER = ("--corner", "resistor=1")
DRAWN = ("-n", "3", "--jobs", "1", "--no-remedy")

TABLE = ("--baseline", "b.json", "--jobs", "1")
PICTURES = {"--plot": "x.svg", "--report": "x.html"}

# Name of the command, words, and every output with its file.
LINES: tuple[tuple[str, tuple[str, ...], dict[str, str]], ...] = (
    ("verify", ("a.toml",), PICTURES),
    ("verify", ("a.toml",), {"--junit": "x.xml"}),
    ("netlist", ("a.toml",), {"-o": "x.cir"}),
    ("bom", ("a.toml",), {"-o": "x.csv"}),
    ("kicad", ("a.toml",), {"-o": "x"}),
    ("simulate", ("a.toml",), {"-o": "x.csv"}),
    ("montecarlo", ("a.toml", *DRAWN), {**PICTURES, "-o": "x.sqlite"}),
    ("montecarlo", ("a.toml", "--sample", "2"), {"--report": "x.html"}),
    ("corners", ("a.toml", *CORNER), {"--report": "x.html"}),
    ("tune", ("a.toml",), PICTURES),
    ("choose", ("a.toml", *DESIGNS), {**PICTURES, "-o": "x", "--store": "x.sqlite"}),
    ("scale", ("a.toml",), {"-o": "x.toml"}),
    ("onset", ("a.toml", "--over", "C=8pF:9pF:3", "--no-confirm"), PICTURES),
    ("sweep", ("a.toml", *GRID), {**PICTURES, "-o": "x.sqlite", "--export": "x.csv"}),
    ("regress", (".", *TABLE), {"--junit": "x.xml", "--markdown": "x.md", "--report": "x.html"}),
    ("stress", ("--only", "one-channel", "--jobs", "1"), {"--junit": "x.xml", "--page": "x.md"}),
    ("accuracy", ("a.toml", "--budget", "0.5"), PICTURES),
    ("reproduce", ("--quick",), {"-o": "x"}),
    ("models show", ("ua741",), {"--plot": "x.svg"}),
    ("models import", (str(VENDOR), *PINS), {"-o": "x.json"}),
    ("new", (), {"FILE": "x.toml"}),
    ("new", (), {"-o": "x.toml"}),
)
SINGLE = [
    (name, words, option, file) for name, words, files in LINES for option, file in files.items()
]
ENDS = {  # of a whole file
    ".svg": b"</svg>", ".html": b"</html>", ".xml": b"</testsuites>", ".cir": b".end",
    ".json": b"}", ".sqlite": b"",
}  # fmt: skip


Entry = tuple[str, Command]


class ReaderGone(io.TextIOBase):
    """A stream whose reader has gone; like a pipe, it fails at the first text."""

    def write(self, text: str) -> int:
        raise BrokenPipeError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_fast(tmp_path / "a.toml", more="[tolerances]\nresistor = 0.01\n")
    (tmp_path / "b.json").write_text(json.dumps({"taction_baseline": 2, "scenes": {}}))
    quick = {"kernels": reproduce.CHAPTERS["kernels"]}
    monkeypatch.setattr(reproduce, "CHAPTERS", quick)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def commands(table: Mapping[str, Command] = COMMANDS, above: str = "") -> Iterator[Entry]:
    """Every command and those below it, by their names."""
    for name, command in table.items():
        yield f"{above}{name}", command
        yield from commands(command.commands, f"{name} ")


def test_every_output_of_every_command_is_listed() -> None:
    outputs = {(name, p.option) for name, each in commands() for p in each.every if p.writes}
    short = {"--output": "-o"}
    assert {(name, option) for name, _, option, _ in SINGLE} == {
        (name, short.get(option, option)) for name, option in outputs
    }


def test_every_path_is_an_input_or_an_output() -> None:
    for name, command in commands():
        for each in command.every:
            kind, metavar = each.attributes.get("type"), each.attributes.get("metavar")
            if isinstance(kind, click.Path) or metavar == "FILE":
                assert each.reads or each.writes, (name, each.name)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("name", "words", "files"), LINES)
@pytest.mark.parametrize("mode", [(), ("--json",)], ids=["text", "json"])
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
    silent = name in ("new", "netlist", "kicad") and not mode  # nothing on stdout
    assert end.value.code == (0 if silent else 141)
    for made in map(Path, files.values()):
        parts = list(made.iterdir()) if made.is_dir() else [made]
        assert parts
        for part in parts:
            assert part.stat().st_size > 80
            assert part.read_bytes().rstrip().endswith(ENDS.get(part.suffix, b""))


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("name", "words", "option", "file"), SINGLE)
def test_a_missing_folder_is_named_before_any_work(
    name: str, words: tuple[str, ...], option: str, file: str
) -> None:
    if file == "x":
        pytest.skip("a folder is made where it is missing")
    there = f"missing/{file}"
    result = taction(*name.split(), *words, *((there,) if option == "FILE" else (option, there)))
    assert result.exit_code == 2
    assert f"{option}: FILE = '{there}': its folder does not exist" in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize(
    "words",
    [
        ("models", "import", "v.cir", *PINS, "-o", "v.cir"),
        ("new", "T.csv", "--matrix", "T.csv", "--strain", "e.csv", "--force"),
        ("choose", "a.toml", "--store", "a.toml"),
        ("scale", "a.toml", "-o", "./a.toml"),
    ],
)
def test_an_input_is_never_overwritten(folder: Path, words: tuple[str, ...]) -> None:
    contents: dict[str, Any] = {"v.cir": VENDOR.read_text(), "T.csv": "1.0\n", "e.csv": "1.0\n"}
    for name, text in contents.items():
        (folder / name).write_text(text)
    contents["a.toml"] = (folder / "a.toml").read_text()
    result = taction(*words)
    assert result.exit_code == 2
    assert "an input of the same command; expected another file" in result.stderr
    assert {name: (folder / name).read_text() for name in contents} == contents
