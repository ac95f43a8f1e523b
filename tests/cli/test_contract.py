"""What holds for every command: its function, its options, its ends, its interruption."""

from __future__ import annotations

import inspect
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import taction
from taction.cli import command as cli
from taction.cli import commands as table
from taction.cli.command import Command, sentences, signature
from taction.system.errors import Complaint
from tests.support.command_lines import LINES, commands
from tests.support.running import document
from tests.support.running import taction as run

NAMES = {"models show": "opamp", "models import": "import_model"}  # `models` has no other two
# Of the command alone: how the result is shown, and where the files stand.
SHOWN = {"verify": {"scenes", "verbose"}}
# Words with which a command ends with 0; those that are not named have their line of `LINES`.
WORDS = {
    "check": "check a.cir",
    "montecarlo": "montecarlo a.toml -n 3",
    "stress": "stress --only nothing-moves",
    "explore": "explore a.toml",
    "mcp": "mcp .",
    "models import": "models import a.cir --subckt A --pins inp,inn,vcc,vee,out",
}


CALLS = dict(commands())
JOBS = [(name, job) for name, job in vars(table).items() if isinstance(job, Command)]


def words_of(name: str) -> list[str]:
    return (WORDS.get(name) or LINES[name.replace(" ", "-")]).split()


@pytest.fixture
def folder(boards: Path) -> Path:
    (boards / "a.cir").write_text("* no netlist\n")
    return boards


@pytest.mark.parametrize("name", CALLS)
def test_a_command_calls_the_function_of_its_name(name: str) -> None:
    """An option is a keyword with its default, and has its sentence; or it shows the result."""
    command = CALLS[name]
    assert command.function == NAMES.get(name, name)
    assert command.function in taction.__all__
    assert command.python_only == (("scene",) if name == "verify" else ())
    made = {p.name: p for p in cli.made(name, command).params}
    shown = {output.name for output in command.outputs} | {"junit"}
    for parameter in command.every:
        function = parameter.of or command.function
        known = signature(function).get(parameter.name)
        told = made[parameter.name].to_info_dict()
        if known is None:
            assert parameter.name in SHOWN.get(name, set()) | shown
        elif known.default is not inspect.Parameter.empty and parameter.flags:
            assert (told.get("default") or None) == (known.default or None)
        if parameter.flags:
            assert told["help"].endswith((".", "*10."))
            sentence = sentences(function).get(parameter.name)
            assert "help" in parameter.attributes or told["help"] == sentence


@pytest.mark.parametrize(("outcome", "status"), [("pass", 0), ("fail", 1), ("inconclusive", 3)])
def test_the_exit_status_of_a_result(outcome: str, status: int) -> None:
    assert cli.status_of(SimpleNamespace(outcome=outcome)) == status
    assert cli.status_of(SimpleNamespace(outcome=outcome, exit_status=2)) == 2
    assert cli.status_of(SimpleNamespace()) == 0


ENDS = [
    (taction.InputError("a.toml", Complaint("key", "1", "expected 2")), 2, "expected 2"),
    (taction.NoVerdictError("no engine ends"), 3, "no engine ends"),
    (KeyboardInterrupt(), 130, "interrupted; no verdict was reached"),
    (taction.Interrupted("5 are stored"), 130, "interrupted; 5 are stored"),
    (ZeroDivisionError("boom"), 3, "this is a bug in taction"),
    (MemoryError(), 3, "out of memory"),
]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(  # one function ends them all: each command has two errors, one has all
    ("name", "error", "status", "says"),
    [
        (name, *end)
        for k, name in enumerate(CALLS)
        for place, end in enumerate(ENDS)
        if (place - k) % 3 == 0 or name == "verify"
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_every_command_ends_alike(
    name: str, error: BaseException, status: int, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ends(*_: Any, **__: Any) -> None:
        raise error

    function = CALLS[name].function
    known = signature(function)
    monkeypatch.setattr(taction, function, ends)
    monkeypatch.setattr(cli, "signature", lambda asked: known if asked == function else {})
    for mode in ((), ("--json",)):
        result = run(*words_of(name), *mode)
        assert result.exit_code == status
        assert says in result.stderr
        if mode and not isinstance(error, KeyboardInterrupt):
            outcome = "bad input" if status == 2 else "inconclusive"
            assert document(result)["outcome"] == outcome


@pytest.mark.usefixtures("folder")
def test_what_is_finished_is_shown_after_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "montecarlo"
    words = [*words_of(name), "--jobs", "1"]
    real = getattr(taction, name)
    monkeypatch.setenv("COLUMNS", "200")  # so that a longer run time changes no table's form

    def interrupted(*given: Any, **more: Any) -> None:
        raise taction.Interrupted("the rest is missing", real(*given, **more))

    whole = run(*words)
    monkeypatch.setattr(taction, name, interrupted)
    monkeypatch.setattr(cli, "signature", lambda asked: inspect.signature(real).parameters)
    result = run(*words)
    assert result.exit_code == 130
    assert len(result.stdout.splitlines()) == len(whole.stdout.splitlines())
    assert "taction: interrupted; the rest is missing" in result.stderr
