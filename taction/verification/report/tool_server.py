"""Tools for programs, over the Model Context Protocol: verify, check, onset, netlist, models, diff.

Each call runs the command in a process of its own, with ``--json``: what a program gets is the
document that the command prints, and the arguments are those that the command takes. The process
reads files of the server's folder only, and has a time limit.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import reduce
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.system.errors import Complaint, InputError, NoVerdictError
from taction.system.foreign_files import FOLDERS, MEGABYTE
from taction.system.output_files import check_extra
from taction.system.processes import ENDING, guard, own_folder

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server
    from mcp.types import CallToolResult

ABOUT = (
    "taction verifies analog boards (scenes, .toml) and checks SPICE decks. Names of files are"
    " relative to the folder of the server, and files outside of it are not read. A result is the"
    " document of the command's --json, in SI units, with a bound beside each number; its `outcome`"
    " is pass, fail or inconclusive."
)
PROCESSES = 2  # that run at once
LARGEST = 64 * MEGABYTE  # bytes of a document
TYPES = {"integer range": "integer", "float range": "number", "boolean": "boolean"}
"""Of a schema, by click's names; others are texts."""
TOOLS: dict[str, tuple[str, tuple[str, ...]]] = {
    "verify": ("verify", ("engine", "settings", "margins", "changes")),
    "check": ("check", ("outputs", "checks", "expect", "over", "ngspice")),
    "onset": ("onset", ("over", "transients")),
    "netlist": ("netlist", ("dialect", "measure")),
    "diff": ("diff", ("engine", "agree")),
    "models": ("parts", ()),
    "model": ("parts show", ()),
}
"""Command and options by the name of the tool. None of them writes a file."""


def mcp(folder: str | Path, *, limit: float = 300.0) -> None:
    """Answer calls of a program over stdin and stdout, by the Model Context Protocol.

    The tools are verify, check, onset, netlist, diff, models and model. A call takes the arguments
    of the command and returns the document of its --json. Files are read in FOLDER only; nothing is
    written. The server ends when stdin does.

    Parameters
    ----------
    folder : path
        The only folder of which files are read; names of files are relative to it.
    limit : float
        Time limit of a call, s.

    Raises
    ------
    InputError
        There is no such folder, stdin is closed, or the SDK is missing (``taction[mcp]``).
    NoVerdictError
        stdin or stdout cannot be used.

    Examples
    --------
    The call ends when stdin is closed.

    >>> import taction
    >>> taction.mcp("scenes")  # doctest: +SKIP
    """
    if not (math.isfinite(limit) and limit > 0.0):
        expected = "expected a finite number of seconds above zero"
        raise InputError("--limit", Complaint("SECONDS", repr(limit), expected))
    made = server(folder, limit)
    if sys.stdin is None:
        raise InputError("mcp", Complaint("stdin", "", "closed; expected a program that asks"))
    import anyio
    from mcp.server.stdio import stdio_server

    def end(number: int, frame: object) -> None:
        """End at once: a thread that waits for a line of stdin does not end before the line."""
        with suppress(OSError):
            os.write(2, b"taction: interrupted; no verdict was reached\n")
        os._exit(128 + number)

    async def run() -> None:
        async with stdio_server() as (read, write):
            await made.run(read, write, made.create_initialization_options())

    main = threading.current_thread() is threading.main_thread()
    known = [number for number in ENDING if main and callable(signal.getsignal(number))]
    handlers = {number: signal.signal(number, end) for number in known}
    try:
        anyio.run(run)
    except BaseExceptionGroup as group:  # of the tasks that read, answer and write
        error: BaseException = group
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        if isinstance(error, BrokenPipeError) or not isinstance(error, OSError):
            raise error from None
        raise NoVerdictError(f"stdin or stdout cannot be used: {error.strerror}") from None
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def server(folder: str | Path, limit: float) -> Server[Any]:
    """Return the server of the tools in a folder; InputError without the folder or the SDK."""
    place = Path(folder)
    if not place.is_dir():
        raise InputError(folder, Complaint("FOLDER", repr(str(folder)), "expected a folder"))
    check_extra("mcp", "mcp")
    import anyio
    from jsonschema import Draft202012Validator
    from mcp.server.lowlevel import Server
    from mcp.types import ListToolsResult, Tool

    names = dict.fromkeys(command.split()[0] for command, _ in TOOLS.values())
    line = [sys.executable, "-P", "-m", "taction", *names, "--help", "--json"]
    told = json.loads(subprocess.run(line, capture_output=True, check=True).stdout)

    def below(found: Any, word: str) -> Any:
        return found["commands"][word]

    helps = {name: reduce(below, command.split(), told) for name, (command, _) in TOOLS.items()}
    tools = {
        name: Tool(name=name, description=command["help"], input_schema=_schema(name, command))
        for name, command in helps.items()
    }
    slots = anyio.CapacityLimiter(PROCESSES)

    async def list_tools(context: Any, asked: Any) -> ListToolsResult:
        return ListToolsResult(tools=[*tools.values()])

    async def call_tool(context: Any, asked: Any) -> CallToolResult:
        if asked.name not in tools:
            return _answer(f"Unknown tool: {asked.name}")
        given = asked.arguments or {}
        found = Draft202012Validator(tools[asked.name].input_schema).iter_errors(given)
        if mistakes := [f"{each.json_path.removeprefix('$.')}: {each.message}" for each in found]:
            return _answer("\n".join(mistakes))
        words = [*_words(asked.name, helps[asked.name], given)]
        return await _run(words, place.resolve(), limit, slots)

    return Server(
        "taction", version=metadata.version("taction"), instructions=ABOUT,
        on_list_tools=list_tools, on_call_tool=call_tool,
    )  # fmt: skip


def _schema(name: str, command: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON Schema of the arguments of a tool: those of its command, and options."""
    shown = [
        each
        for each in command["params"]
        if each["param_type_name"] == "argument" or each["name"] in TOOLS[name][1]
    ]
    return {
        "type": "object",
        "properties": {each["name"]: _property(each) for each in shown},
        "required": [each["name"] for each in shown if each["required"]],
        "additionalProperties": False,
    }


def _property(parameter: Mapping[str, Any]) -> dict[str, Any]:
    about = parameter.get("help") or f"{parameter['name']}: a file of the server's folder"
    kind = parameter["type"]
    made: dict[str, Any] = {"type": TYPES.get(kind["name"], "string")}
    limits = {"enum": "choices", "minimum": "min", "maximum": "max"}
    made |= {key: value for key, of in limits.items() if (value := kind.get(of)) is not None}
    if parameter["multiple"] or parameter["nargs"] == -1:
        made = {"type": "array", "items": made, "minItems": int(parameter["required"])}
    return made | {"description": about}


def _words(name: str, command: Mapping[str, Any], given: Mapping[str, Any]) -> Iterator[str]:
    """Yield the words of a command line with the arguments of a tool."""

    def values(parameter: Mapping[str, Any]) -> list[Any]:
        value = given.get(parameter["name"])
        return value if isinstance(value, list) else [] if value is None else [value]

    arguments = [each for each in command["params"] if each["param_type_name"] == "argument"]
    yield from (*TOOLS[name][0].split(), "--json")
    for option in command["params"]:
        for value in values(option) if option not in arguments else ():
            flag = option["opts"][-1]
            if not option["is_flag"]:
                yield f"{flag}={value}"
            else:
                yield from [flag] if value else option["secondary_opts"]
    yield "--"
    for argument in arguments:
        yield from map(str, values(argument))


async def _run(words: list[str], folder: Path, limit: float, slots: Any) -> CallToolResult:
    """Run a command line of the program in a folder, with a time limit, s."""
    import anyio

    line = [*guard(), sys.executable, "-P", "-m", "taction", *words]
    async with slots:
        with own_folder() as place, anyio.move_on_after(limit):
            own = {FOLDERS: json.dumps([str(folder), str(place)]), "NO_COLOR": "1"}
            env = {**os.environ, **own, "TMPDIR": str(place)}
            try:
                done = await anyio.run_process(
                    line, stdin=subprocess.DEVNULL, check=False, cwd=folder, env=env
                )
            except (OSError, ValueError) as error:
                return _answer(f"the command cannot run: {error}")
            said = done.stderr.decode(errors="replace").strip()
            if len(done.stdout) > LARGEST:
                size = f"over {LARGEST / MEGABYTE:g} MB, the largest document that is sent"
                return _answer(f"{size}; ask for less, or run the command with --json")
            try:
                return _answer(said, json.loads(done.stdout))
            except ValueError:
                return _answer(said or f"no document; exit status {done.returncode}")
    return _answer(f"no result within the limit of {limit:g} s")


def _answer(said: str, document: dict[str, Any] | None = None) -> CallToolResult:
    """Return a document, or why there is none, as the SDK sends it; beside it, what was said."""
    from mcp.types import CallToolResult, TextContent

    error = document is None or document.get("taction", {}).get("schema", "").startswith("error")
    texts = [said] if document is None else filter(None, [json.dumps(document), said])
    content: Any = [TextContent(type="text", text=text) for text in texts]
    return CallToolResult(content=content, structured_content=document, is_error=error)
