"""The command line: exit statuses, documents and their schemas, and what stands in a terminal."""

from __future__ import annotations

import json
import re
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taction.cli import printing
from taction.cli.commands import COMMANDS
from taction.cli.main import FAMILIES, RENAMED, SECTIONS
from taction.verification.report.documents.document_catalogue import (
    MODELS,
    schema,
    schema_name,
    schemas,
    units,
)
from tests.support.command_lines import LINES, line
from tests.support.entries import write_fast
from tests.support.paths import ROOT, SCENES
from tests.support.running import document, python, taction

TUNED = str(SCENES / "tuned-breadboard.toml")
FAST = ("--engine", "statespace")


def test_a_part_set_by_its_base_says_which_figures_the_scene_keeps() -> None:
    words = ("verify", "scenes/paper-breadboard.toml", "--engine", "statespace", "--changes", "0")
    kept = "another base of the op-amp: it keeps the scene's own dc_gain, gbw,"
    found = taction(*words, "--set", "opamp=ua741", "--json")
    assert kept in found.stderr
    assert [text for text in document(found)["warnings"] if text.startswith(kept)] != []
    assert kept not in taction(*words, "--set", "design.opamp=ua741").stderr
    both = taction(*words, "--set", "opamp=ua741", "--set", "opamp.gbw=1MHz").stderr
    assert "own dc_gain," in both
    assert "gbw," not in both


def test_netlist_prints_the_deck_and_lists_what_is_left_out() -> None:
    result = taction("netlist", TUNED)
    assert result.exit_code == 0
    assert result.stdout.startswith(".title taction board\n* scene tuned-breadboard: 7 channels")
    assert result.stdout.endswith(".end\n")
    found = document(taction("netlist", TUNED, "--json"))
    assert found["deck"] == result.stdout
    assert "antilog stages and bias current" in {each["what"] for each in found["omissions"]}


@pytest.mark.parametrize("words", [("--json", "--help"), ("--help", "--json"), ("-h", "--json")])
def test_one_document_has_all_commands(words: tuple[str, ...]) -> None:
    result = taction(*words)
    assert result.exit_code == 0
    found = document(result)
    assert list(found["commands"]) == [name for names in SECTIONS.values() for name in names]
    assert {"show", "import"} <= found["commands"]["parts"]["commands"].keys()
    assert "waveforms" in found["commands"]["export"]["commands"]
    verify = {each["name"]: each for each in found["commands"]["verify"]["params"]}
    assert verify["scenes"]["required"]
    assert verify["changes"]["opts"] == ["--changes"]
    assert verify["changes"]["default"] == 2000.0


def test_old_names_print_what_the_new_ones_print() -> None:
    """Every command is below a listed name; its old name stays, with the same output."""
    listed = {name for names in SECTIONS.values() for name in names}
    shown = {f"{family} {name}": name for family, (names, _) in FAMILIES.items() for name in names}
    reached = listed | set(shown.values())
    assert {RENAMED.get(name, name) for name in reached} >= set(COMMANDS)
    for new, short in [*shown.items(), *((name, name) for name in RENAMED if name in listed)]:
        old = RENAMED.get(short, short)
        a, b = (taction(*words.split(), "--help").stdout for words in (new, old))
        assert a.replace(f"taction {new}", f"taction {old}") == b
    assert sum(map(len, SECTIONS.values())) <= 19


def complete(shell: str, *words: str) -> str:
    """What the shell is told for the last word."""
    line = " ".join(["taction", *words])
    place = str(len(words)) if shell != "fish" else words[-1]
    variables = {"COMP_WORDS": line, "COMP_CWORD": place, "_TACTION_COMPLETE": f"{shell}_complete"}
    run = python("-m", "taction", env=variables)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_completes_commands_and_options(shell: str) -> None:
    assert "verify" in complete(shell, "ver")
    assert "netlist" not in complete(shell, "ver")
    assert "--margins" in complete(shell, "verify", "--mar")


FOLDER = ROOT / "docs" / "schemas"
ONE = """
[problem]
kind = "matrix"
matrix = [[2.0]]
strain = [1.0]
[design]
capacitance = "1nF"
gain = "10kohm"
[analysis]
engine = "statespace"
"""


@pytest.fixture
def folder(boards: Path) -> Path:
    (boards / "ringing.toml").write_text(ONE.replace("1nF", "10pF").replace('gain = "10kohm"', ""))
    other = write_fast(boards / "other.toml").read_text()
    (boards / "ngspice.toml").write_text(
        other.replace('"statespace"', '"ngspice"').replace("[checks]", '[checks]\nnoise = "1V"')
    )
    exponential = other.replace("[design]", '[design]\namplifier = "exponential"')
    (boards / "exponential.toml").write_text(exponential)
    short = other.replace('"statespace"', '"ngspice"\nstop = "10ns"')
    (boards / "short.toml").write_text(short)
    return boards


def closed(part: dict[str, Any]) -> dict[str, Any]:
    """A part of a schema, at which neither any field nor any value is accepted."""
    assert part.get("type") != "object" or part.get("additionalProperties", True) is not True
    for field in part.get("properties", {}).values():
        assert {"type", "$ref", "anyOf", "const", "enum"} & field.keys(), part
    return part


def test_the_published_schemas_are_valid_without_open_parts_and_those_of_all_commands() -> None:
    names = {name.partition(",")[0] for name in LINES}
    assert names == set(MODELS) - {"explore"}  # which serves until Ctrl-C: `test_explore`
    known = {name.partition("-")[0] for name in MODELS}
    assert known == set(COMMANDS) - {"mcp"} | {"error"}  # its stdout is the protocol's
    published = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    assert published == dict(schemas()), "run: make schemas"
    for file, text in published.items():
        known = json.loads(text, object_hook=closed)
        jsonschema.Draft202012Validator.check_schema(known)
        assert f"{known['$id']}.json" == file
    verdict = json.loads(published["verify-2.json"])
    assert verdict["properties"]["settling_time"]["unit"] == "s"


@pytest.mark.usefixtures("folder", "quick_stories")
@pytest.mark.parametrize("name", LINES)
def test_documents_fit_schemas(name: str, ngspice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name == "error, no ngspice":
        monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    found = document(result := taction(*line(name), "--json"))
    kind = name.partition(",")[0]
    validator = jsonschema.Draft202012Validator(schema(kind))
    assert [(each.json_path, each.message[:300]) for each in validator.iter_errors(found)] == []
    head = found["taction"]
    assert head["schema"] == schema_name(kind)
    assert (FOLDER / f"{head['schema']}.json").is_file()
    assert re.fullmatch(r"\d+\.\d+.*", head["version"])
    if name == "error, no ngspice":
        assert (result.exit_code, found["error"]["kind"]) == (3, "SimulatorNotFound")
        assert "/nowhere/ngspice" in result.stderr
    else:
        assert head["simulator"].startswith("ngspice-")
        assert head["solver"] in ("KLU", "SPARSE")
    assert head["units"] == units(kind)


def test_lines_become_rare(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(printing, "monotonic", count(0.0, 1.0).__next__)
    line = printing.StageLine()
    for number in range(1, 3601):
        line(str(number))
    said = capsys.readouterr().err.replace("taction: ", "").split()
    assert said[:5] == ["10", "15", "23", "35", "53"]  # seconds, each 1.5 times the last
    assert len(said) == 20
    assert max(int(b) - int(a) for a, b in pairwise(said)) == 300
