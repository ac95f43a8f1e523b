"""The tools for programs, called by the client of the same SDK."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import anyio
import jsonschema
import pytest
from mcp.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

from taction.verification.report import tool_server
from taction.verification.report.documents.document_catalogue import schema
from taction.verification.report.tool_server import TOOLS, server
from tests.support import nightly
from tests.support.entries import write_fast
from tests.support.running import taction

SCENE = "a.toml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tmp_path = tmp_path_factory.mktemp("served")
    place = tmp_path / "boards"
    place.mkdir()
    write_fast(place / SCENE)
    write_fast(tmp_path / "outside.toml")
    (place / "link.toml").symlink_to(tmp_path / "outside.toml")
    (place / "outside.cir").write_text("a\n.include ../outside.toml\nR1 a 0 1\n.end\n")
    problem = 'kind = "matrix"\nmatrix = "../T.csv"\nstrain = "../T.csv"'
    (place / "matrix.toml").write_text(f"[problem]\n{problem}\n")
    (tmp_path / "T.csv").write_text("2.0\n")
    (place / "json.py").write_text("raise SystemExit('a module of the folder was imported')\n")
    (place / "rc.cir").write_text("rc\nV1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n.end\n")
    return place


def asked(folder: Path, limit: float, ask: Callable[[Any], Awaitable[Any]]) -> Any:
    async def run() -> Any:
        async with Client(server(folder, limit)) as client:
            return await ask(client)

    return anyio.run(run)


def test_a_program_speaks_with_the_command_over_stdin(folder: Path) -> None:
    """As it is installed: the list of tools, and a verdict that is the document of --json."""

    async def run() -> tuple[Any, Any]:
        command = StdioServerParameters(
            command=sys.executable, args=["-P", "-m", "taction", "mcp", str(folder)]
        )
        async with Client(stdio_client(command)) as client:
            listed = await client.list_tools()
            return listed.tools, await client.call_tool("verify", {"scenes": [SCENE]})

    tools, found = anyio.run(run)
    assert [tool.name for tool in tools] == list(TOOLS)
    for tool in tools:
        assert {*TOOLS[tool.name][1]} <= tool.input_schema["properties"].keys()
    verify = tools[0].input_schema
    assert verify["required"] == ["scenes"]
    assert verify["properties"]["engine"]["type"] == "string"
    assert all(
        each["description"] for tool in tools for each in tool.input_schema["properties"].values()
    )
    assert not found.is_error
    assert found.structured_content["outcome"] == "pass"
    jsonschema.validate(found.structured_content, schema("verify"))


REFUSED: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("verify", {"scenes": ["../outside.toml"]}, "outside of the folders that are read"),
    ("verify", {"scenes": ["link.toml"]}, "outside of the folders that are read"),
    ("verify", {"scenes": ["matrix.toml"]}, "outside of the folders that are read"),
    ("check", {"deck": "outside.cir"}, "is outside the deck's folder and not read"),
    ("verify", {"scenes": ["--help"]}, "No such file"),
    ("verify", {"scenes": ["a\0b"]}, "null byte"),
    ("verify", {"scene": SCENE}, "'scenes' is a required property"),
    ("verify", {"scenes": [SCENE], "report": "a.html"}, "'report' was unexpected"),
    ("verify", {"scenes": [SCENE], "changes": "soon"}, "changes: 'soon' is not of type 'number'"),
    ("simulate", {"scene": SCENE}, "Unknown tool: simulate"),
)


CHECK = {"deck": "rc.cir", "checks": ["settling=2us@1%"], "ngspice": False}


@pytest.fixture(scope="module")
def answers(folder: Path) -> list[Any]:
    """What one server says of all that is refused, of a check, and of a document over its limit."""

    async def ask(client: Any) -> list[Any]:
        calls = [*((name, given) for name, given, _ in REFUSED), ("check", CHECK)]
        found = [await client.call_tool(*each) for each in calls]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(tool_server, "LARGEST", 1000)
            return [*found, await client.call_tool("models", {})]

    found: list[Any] = asked(folder, 300.0, ask)
    return found


def test_what_is_refused_is_an_error_with_its_reason(answers: list[Any]) -> None:
    for found, (_, given, reason) in zip(answers[:-2], REFUSED, strict=True):
        assert found.is_error, given
        assert reason in " ".join(block.text for block in found.content)


def test_options_reach_the_command_and_a_failed_check_is_a_result(answers: list[Any]) -> None:
    assert not answers[-2].is_error
    found = answers[-2].structured_content
    assert found["outcome"] == "fail"
    assert found["poles"][0]["real"] == pytest.approx(-1e6)


def test_a_document_that_is_too_large_is_an_answer(answers: list[Any]) -> None:
    assert answers[-1].is_error
    assert "over 0.001 MB, the largest document that is sent" in answers[-1].content[0].text


def test_a_call_ends_at_its_limit(folder: Path) -> None:
    given = {"scene": SCENE, "over": "C"}
    found = asked(folder, 0.05, lambda client: client.call_tool("onset", given))
    assert found.is_error
    assert "no result within the limit of 0.05 s" in found.content[0].text


def test_a_folder_is_needed(tmp_path: Path) -> None:
    result = taction("mcp", str(tmp_path / "none"))
    assert result.exit_code == 2
    assert "expected a folder" in result.stderr


def first_words() -> bytes:
    about = {"name": "test", "version": "1"}
    given = {"protocolVersion": "2024-11-05", "capabilities": {}, "clientInfo": about}
    asked = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": given}
    return json.dumps(asked).encode() + b"\n"


@pytest.mark.parametrize("number", [signal.SIGINT, *nightly(signal.SIGTERM)])
def test_a_signal_ends_the_server_while_stdin_is_open(folder: Path, number: int) -> None:
    words = [sys.executable, "-P", "-m", "taction", "mcp", str(folder)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(first_words())
        process.stdin.flush()
        assert b"taction" in process.stdout.readline()
        process.send_signal(number)
        assert process.wait(20.0) == 128 + number
        said = process.stderr.read()
    assert said == b"taction: interrupted; no verdict was reached\n"
