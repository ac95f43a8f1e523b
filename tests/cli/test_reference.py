"""``taction --json --help`` and shell completion."""

from __future__ import annotations

import pytest

from taction.cli.main import COMMANDS, FAMILIES, RENAMED, SECTIONS
from tests.support.paths import ROOT
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
    published = {file.stem for file in (ROOT / "docs" / "schemas").glob("*.json")}
    for command in found["commands"]:
        assert set(command["schemas"]) <= published
        assert "--json" in {flag for option in command["options"] for flag in option["flags"]}


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
