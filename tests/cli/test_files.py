"""Files that a command writes: whole, never an input; what a full disk and a gone reader leave."""

from __future__ import annotations

import io
import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import pytest
from lxml import html

from taction.cli.command import Command
from taction.cli.main import COMMANDS, main
from taction.verification.evidence.paper import reproduce
from tests.support.entries import write_fast
from tests.support.paths import ROOT, SCENES
from tests.support.running import document, taction

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


TOLERANCES = "\n[tolerances]\nresistor = 0.01\n"
WITH_REPORT = [
    name
    for name, command in COMMANDS.items()
    if any(output.name == "report" for output in command.job.outputs)
]


def headings(file: Path) -> list[str]:
    tree = html.document_fromstring(file.read_text("utf-8"))
    return [str(each.text) for each in tree.xpath("//h2")]


@pytest.mark.parametrize(
    ("words", "heading", "summary"),
    [
        (("verify",), "Waveforms", "All 4 checks pass"),
        (("corners", "--corner", "resistor=1"), "Corners", "1 corner: 1 "),
        (("montecarlo", "--sample", "3"), "Waveforms", ""),
        (("onset", "--over", "C=5pF:50pF:7", "--no-confirm"), "Crossings", "Stable for C: "),
    ],
)
def test_a_command_writes_its_report(
    tmp_path: Path, words: tuple[str, ...], heading: str, summary: str
) -> None:
    scene, out = write_fast(tmp_path / "a.toml", more=TOLERANCES), tmp_path / "a.html"
    run = taction(words[0], str(scene), *words[1:], "--report", str(out))
    assert run.exit_code in (0, 1, 3), run.output
    assert heading in headings(out)
    assert f"wrote {out}" in run.stderr
    tree = html.document_fromstring(out.read_text("utf-8"))
    assert summary in tree.xpath("string(//p[@class='verdict'])")


def test_a_regression_writes_its_report(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_fast(folder / "a.toml")
    files = ("--baseline", str(tmp_path / "b.json"), "--report", str(tmp_path / "a.html"))
    run = taction("regress", str(folder), *files, "--update", "--jobs", "1")
    assert run.exit_code == 0, run.output
    assert headings(tmp_path / "a.html")[0] == "Scenes"


@pytest.mark.parametrize("name", WITH_REPORT)
def test_a_report_that_is_no_page_is_refused_before_any_work(tmp_path: Path, name: str) -> None:
    scene = write_fast(tmp_path / "a.toml", more=TOLERANCES)
    target = str(tmp_path) if name == "regress" else str(scene)
    more = {
        "sweep": ("--over", "C=1pF,2pF", "-o", str(tmp_path / "a.sqlite")),
        "onset": ("--over", "C"),
        "choose": ("--store", str(tmp_path / "a.sqlite")),
        "regress": ("--baseline", str(tmp_path / "b.json"), "--update"),
    }
    run = taction(name, target, *more.get(name, ()), "--report", str(tmp_path / "a.txt"))
    assert run.exit_code == 2
    assert "expected a file that ends in .html" in run.output
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.toml"]


SCENE = str(SCENES / "tuned-breadboard.toml")
OVER = ("--over", "C=50p:500p:12", "--jobs", "2")


def run(*words: str, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run taction, where no file may have more than `limit` bytes."""

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        [sys.executable, "-m", "taction", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=os.environ,
        preexec_fn=limited,
    )


def without_times(text: str) -> list[dict[str, object]]:
    points: list[dict[str, object]] = json.loads(text)["points"]
    return [{k: v for k, v in point.items() if k != "seconds"} for point in points]


@pytest.mark.parametrize("limit", [10_000, 60_000])
def test_a_sweep_goes_on_with_room(limit: int, tmp_path: Path) -> None:
    words = ("sweep", SCENE, *OVER, "--engine", "statespace", "--json", "-o")
    full = run(*words, str(tmp_path / "a.sqlite"), limit=limit)
    assert full.returncode == 3, full.stderr
    assert json.loads(full.stdout)["error"]["kind"] == "OutOfDisk"
    assert "make room on the disk and run the same command again" in full.stderr
    again = run(*words, str(tmp_path / "a.sqlite"))
    assert again.returncode == 0, again.stderr
    whole = run(*words, str(tmp_path / "b.sqlite"))
    assert without_times(again.stdout) == without_times(whole.stdout)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.csv"),
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.parquet"),
        (("simulate", SCENE, "--engine", "statespace", "-o"), "a.raw"),
        (("verify", SCENE, "--engine", "statespace", "--plot"), "a.png"),
        (("verify", SCENE, "--engine", "statespace", "--plot"), "a.svg"),
        (("netlist", SCENE, "--split", "-o"), "a.cir"),
        (("new", "--force"), "a.toml"),
        (("stress", "--only", "nothing-moves", "--junit"), "a.xml"),
    ],
)
def test_an_output_is_whole_or_unchanged(words: tuple[str, ...], name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("old")
    done = run(*words, str(tmp_path / name), limit=500)
    assert done.returncode == 2, done.stderr
    assert f"{name}: FILE: File too large (ulimit -f); expected a file" in done.stderr
    assert "Traceback" not in done.stderr
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: "old"}


def test_a_verdict_has_the_question_as_a_warning(tmp_path: Path) -> None:
    scene = write_fast(tmp_path / "a.toml", capacitance="10mF")
    found = document(taction("verify", str(scene), "--json", "--changes", "0"))
    assert any("10 mF is not between" in text for text in found["warnings"])


@pytest.mark.parametrize("words", [("netlist",), ("solve",), ("bom",)])
def test_other_commands_ask_on_stderr(tmp_path: Path, words: tuple[str, ...]) -> None:
    scene = write_fast(tmp_path / "a.toml", capacitance="10mF")
    result = taction(*words, str(scene))
    assert "taction: question: design.capacitance = 10 mF" in result.stderr
    assert "question" not in result.stdout
    usual = write_fast(tmp_path / "b.toml")
    assert "question" not in taction(*words, str(usual)).stderr


def test_a_sweep_asks_about_its_range(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_fast(tmp_path / "a.toml")
    result = taction("sweep", "a.toml", "--over", "C=20pF:10pF:2", "--jobs", "1")
    assert "taction: question: --over C: the range falls from 20 pF to 10 pF" in result.stderr
    assert result.exit_code == 0


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "a.toml", "--plot", "x.png"),
        ("onset", "a.toml", "--over", "C=8pF:9pF:3", "--no-confirm", "--plot", "x.png"),
        ("verify", "a.toml", "--junit", "x.png"),
    ],
)
def test_a_closed_pipe_leaves_the_picture(tmp_path: Path, words: tuple[str, ...]) -> None:
    write_fast(tmp_path / "a.toml")
    reader, writer = os.pipe()
    os.close(reader)
    run = subprocess.run(
        [sys.executable, "-c", "from taction.cli.main import main; main()", *words],
        stdout=writer,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    os.close(writer)
    assert run.returncode == 141
    assert (tmp_path / "x.png").stat().st_size > 200
