"""``taction --json --help`` and shell completion."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest

from taction.cli.main import COMMANDS, FAMILIES, RENAMED, SECTIONS
from taction.cli.reference import EXAMPLES, EXIT_STATUSES
from tests.support.running import document, python, taction


@pytest.mark.parametrize("words", [("--json", "--help"), ("--help", "--json"), ("-h", "--json")])
def test_one_document_has_all_commands(words: tuple[str, ...]) -> None:
    result = taction(*words)
    assert result.exit_code == 0
    found = document(result)
    names = [command["name"] for command in found["commands"]]
    listed = [name for names in SECTIONS.values() for name in names if name not in FAMILIES]
    assert [name for name in names if " " not in name] == listed
    assert {"parts show", "yield montecarlo", "export waveforms"} <= set(names)
    assert set(found["exit_statuses"]) == {str(status) for status in EXIT_STATUSES}
    for command in found["commands"]:
        assert set(command["schemas"]) <= set(found["schemas"])
        assert "--json" in {flag for option in command["options"] for flag in option["flags"]}
    assert found["scene_schema"]["properties"]["design"]


def test_old_names_print_what_the_new_ones_print() -> None:
    """Every command is below a listed name; its old name stays, with the same output."""
    listed = {name for names in SECTIONS.values() for name in names}
    shown = {f"{family} {name}": name for family, (names, _) in FAMILIES.items() for name in names}
    reached = listed | set(shown.values())
    options = {"solve": "verify --solve", "scale": "new --from"}
    assert {RENAMED.get(name, name) for name in reached} | set(options) >= set(COMMANDS)
    for new, short in [*shown.items(), *((name, name) for name in RENAMED if name in listed)]:
        old = RENAMED.get(short, short)
        a, b = (taction(*words.split(), "--help").stdout for words in (new, old))
        assert a.replace(f"taction {new}", f"taction {old}") == b
    assert (
        sum(map(len, SECTIONS.values())) <= 18
    )  # sixteen, and `check` and `mcp`, which came later


def test_an_old_name_has_the_document_of_the_new_one() -> None:
    scene = "scenes/tuned-breadboard.toml"
    for new, old in (
        (f"verify --solve {scene}", f"solve {scene}"),
        ("parts show ua741", "models show ua741"),
        (f"export bom {scene}", f"bom {scene}"),
    ):
        a, b = (taction(*words.split(), "--json") for words in (new, old))
        first, second = document(a), document(b)
        for each in (first, second):
            each.pop("seconds", None)
        assert (a.exit_code, first["taction"]["schema"]) == (0, second["taction"]["schema"])
        assert first == second


def test_the_name_alone_says_what_to_type_first() -> None:
    run = taction()
    assert run.exit_code == 0
    assert [line.split()[:2] for line in run.stdout.splitlines()][:3] == [
        ["taction", "demo"],
        ["taction", "new"],
        ["taction", "verify"],
    ]
    assert len(run.stdout.splitlines()) <= 5


def test_options_are_those_of_the_help_text() -> None:
    for command in document(taction("--json", "--help"))["commands"]:
        shown = set(
            re.findall(r"(?<![\w-])--[a-z][a-z-]*", taction(*command["name"].split(), "-h").stdout)
        )
        flags = {flag for option in command["options"] for flag in option["flags"]}
        assert {flag for flag in flags if flag.startswith("--")} <= shown


def test_types_defaults_and_arguments() -> None:
    commands = {c["name"]: c for c in document(taction("--json", "--help"))["commands"]}
    options = {o["name"]: o for o in commands["yield montecarlo"]["options"]}
    assert (options["samples"]["type"], options["samples"]["default"]) == ("integer", 1000)
    assert options["engine"]["choices"] == ["auto", "ngspice", "statespace"]
    (scenes,) = commands["verify"]["arguments"]
    assert (scenes["name"], scenes["required"], scenes["several"]) == ("scenes", True, True)
    assert "taction_ngspice" in map(str.lower, document(taction("--json", "--help"))["environment"])


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: str(example["task"]))
def test_an_example_gives_its_answer(
    example: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ngspice: str
) -> None:
    """With nothing but the document: files, call, schema and the place of the answer."""
    monkeypatch.chdir(tmp_path)
    for name, text in example["files"].items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    program, *words = shlex.split(example["call"])
    assert program == "taction"
    found = document(taction(*words))
    assert found["taction"]["schema"] == example["schema"]
    answer = found
    for step in example["read"]:
        answer = answer[step]
    assert isinstance(answer, str | float)
    last = [step for step in example["read"] if isinstance(step, str)][-1]
    assert example["schema"] in document(taction("--json", "--help"))["fields"][last]["schemas"]


def test_a_field_is_found_with_its_unit_and_its_schemas() -> None:
    found = document(taction("--json", "--help"))
    assert found["fields"]["settling_time"]["unit"] == "s"
    assert {"verify-2", "sweep-2"} <= set(found["fields"]["settling_time"]["schemas"])
    assert found["scene_file"]["symbols"]["C"] == "design.capacitance"


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
    assert "--exclude" in complete(shell, "verify", "--ex")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_gets_its_script(shell: str) -> None:
    run = python("-m", "taction", env={"_TACTION_COMPLETE": f"{shell}_source"})
    assert run.returncode == 0, run.stderr
    assert f"_TACTION_COMPLETE={shell}_complete" in run.stdout
    if shell == "bash":
        checked = subprocess.run(["bash", "-n"], input=run.stdout, text=True, check=False)
        assert checked.returncode == 0
