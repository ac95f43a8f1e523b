"""Tools for programs, over the Model Context Protocol: verify, check, onset, netlist, models, diff.

Each call runs the command in a process of its own, with ``--json``: what a program gets is the
document that the command prints, and the arguments are those that the command takes. The process
reads files of the server's folder only, has a time limit, and leaves nothing behind.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from taction.system.errors import Complaint, InputError, NoVerdictError
from taction.system.foreign_files import FOLDERS, MEGABYTE
from taction.system.processes import guard

if TYPE_CHECKING:
    from mcp.server import MCPServer
    from mcp.types import CallToolResult

PACKAGE = "the server needs the SDK of MCP: pip install 'taction[mcp]'"
ABOUT = (
    "taction verifies analog boards (scenes, .toml) and checks SPICE decks. Names of files are"
    " relative to the folder of the server, and files outside of it are not read. A result is the"
    " document of the command's --json, in SI units, with a bound beside each number; its `outcome`"
    " is pass, fail or inconclusive."
)
PROCESSES = 2  # that run at once
LARGEST = 64 * MEGABYTE  # bytes of a document
ASKING = "expected a program that asks over stdin"
TYPES = {"integer": int, "number": float, "boolean": bool}  # others are texts
TOOLS: dict[str, tuple[str, tuple[str, ...]]] = {
    "verify": ("verify", ("engine", "settings", "margins", "changes")),
    "check": ("check", ("outputs", "checks", "expect", "over", "ngspice")),
    "onset": ("onset", ("over", "transients")),
    "netlist": ("netlist", ("dialect", "parameters", "measure")),
    "diff": ("diff", ("engine", "agree")),
    "models": ("parts", ()),
    "model": ("parts show", ()),
}
"""Command and options by the name of the tool. None of them writes a file."""


def serve(folder: str | Path, limit: float) -> None:
    """Answer calls over stdin and stdout until stdin ends.

    InputError: see `server`, or nothing can be read from stdin. NoVerdictError: stdout takes no
    more.
    """
    if not (math.isfinite(limit) and limit > 0.0):
        expected = "expected a finite number of seconds above zero"
        raise InputError("--limit", Complaint("SECONDS", repr(limit), expected))
    made = server(folder, limit)._lowlevel_server
    if sys.stdin is None:
        raise InputError("mcp", Complaint("stdin", "", f"closed; {ASKING}"))
    import anyio
    from mcp.server.stdio import stdio_server

    async def run() -> None:
        async with stdio_server(cast(Any, _Lines())) as (read, write):
            await made.run(read, write, made.create_initialization_options())

    try:
        anyio.run(run)
    except BaseExceptionGroup as group:  # of the tasks that read, answer and write
        error: BaseException = group
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        if isinstance(error, BrokenPipeError) or not isinstance(error, OSError):
            raise error from None
        raise NoVerdictError(f"stdout cannot be written: {error.strerror}") from None


class _Lines:
    """The lines of stdin; waiting for one can be cancelled, unlike a thread that reads."""

    async def __aiter__(self) -> AsyncIterator[str]:
        """Yield each line as text."""
        import anyio

        number, rest = sys.stdin.fileno(), b""
        while True:
            with suppress(PermissionError):  # a file and /dev/null are always ready
                await anyio.wait_readable(number)
            try:
                part = os.read(number, MEGABYTE)
            except OSError as error:
                text = f"{error.strerror}; {ASKING}"
                raise InputError("mcp", Complaint("stdin", "", text)) from None
            *lines, rest = (rest + part).split(b"\n")
            for line in lines if part else filter(None, [rest]):
                yield line.decode(errors="replace")
            if not part:
                return


def server(folder: str | Path, limit: float) -> MCPServer[Any]:
    """Return the server of the tools in a folder; InputError without the folder or the SDK."""
    place = Path(folder)
    if not place.is_dir():
        raise InputError(folder, Complaint("FOLDER", repr(str(folder)), "expected a folder"))
    try:
        from mcp.server import MCPServer
    except ImportError:
        raise InputError("mcp", Complaint("FOLDER", repr(str(folder)), PACKAGE)) from None
    import anyio

    names = dict.fromkeys(command.split()[0] for command, _ in TOOLS.values())
    line = [sys.executable, "-P", "-m", "taction", *names, "--help", "--json"]
    told = json.loads(subprocess.run(line, capture_output=True, check=True).stdout)
    known = {each["name"]: each for each in told["commands"]}
    slots = anyio.CapacityLimiter(PROCESSES)
    return MCPServer(
        "taction",
        version=metadata.version("taction"),
        instructions=ABOUT,
        log_level="CRITICAL",
        tools=[
            _tool(name, known[command], options, Commands(place.resolve(), limit, slots))
            for name, (command, options) in TOOLS.items()
        ],
    )


def _tool(name: str, command: dict[str, Any], options: tuple[str, ...], commands: Commands) -> Any:
    """Return a command, as its --help --json has it, as a tool of the SDK with some options."""
    from mcp.server.mcpserver.context import Context
    from mcp.server.mcpserver.tools.base import Tool
    from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase, FuncMetadata
    from pydantic import create_model

    taken = [each for each in command["options"] if each["name"] in options]
    fields: Any = {each["name"]: _field(each) for each in (*command["arguments"], *taken)}

    class Arguments(ArgModelBase, extra="forbid"):
        """The arguments; an unknown one is refused."""

    async def call(context: Context[Any, Any], **given: Any) -> CallToolResult:
        words = [*TOOLS[name][0].split(), "--json"]
        for option in taken:
            words += _option(option, given[option["name"]])
        values = [given[each["name"]] for each in command["arguments"]]
        words += ["--", *(str(each) for value in values for each in _listed(value))]
        return await commands.run(words, context.report_progress)

    model = create_model(name, __base__=Arguments, **fields)
    return Tool(
        fn=call,
        name=name,
        description=command["help"],
        parameters=model.model_json_schema(),
        fn_metadata=FuncMetadata(arg_model=model),
        is_async=True,
        context_kwarg="context",
    )


def _field(parameter: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return type and description of one argument or option."""
    from pydantic import Field

    form = f" ({parameter['metavar']})" if parameter.get("metavar") else ""
    about = parameter.get("help") or f"{parameter['name']}: a file of the server's folder"
    kind: Any = TYPES.get(parameter["type"], str)
    if parameter["type"] == "choice":
        kind = Literal[tuple(parameter["choices"])]
    kind = Annotated[kind, Field(ge=parameter.get("min"), le=parameter.get("max"))]
    if parameter["several"]:
        kind = Annotated[list[kind], Field(min_length=int(parameter["required"]))]
    default = ... if parameter["required"] else None
    return kind, Field(default, description=f"{about}{form}")


def _listed(value: Any) -> list[Any]:
    """Return a value as a list; None has no values."""
    return value if isinstance(value, list) else [] if value is None else [value]


def _option(option: Mapping[str, Any], value: Any) -> Iterator[str]:
    """Yield an option as words of a command line."""
    flag = next(each for each in option["flags"] if each.startswith("--"))
    if not option["is_flag"]:
        yield from (f"{flag}={each}" for each in _listed(value))
    elif value is not None:
        against = [each for each in option["flags"] if each.startswith("--no-")]
        yield from [flag] if value else against


@dataclass(frozen=True, slots=True)
class Commands:
    """Commands in a folder, each with a time limit, s; `slots` says how many run at once."""

    folder: Path
    limit: float
    slots: Any

    async def run(self, words: list[str], report: Callable[..., Any]) -> CallToolResult:
        """Run a command line without the program; each line of stderr is reported as progress."""
        import anyio

        out, lines = bytearray(), list[str]()
        line = [*guard(), sys.executable, "-P", "-m", "taction", *words]
        async with self.slots:
            with tempfile.TemporaryDirectory() as place, anyio.move_on_after(self.limit) as scope:
                own = {FOLDERS: json.dumps([str(self.folder), place]), "TMPDIR": place}
                try:
                    process = await anyio.open_process(
                        line,
                        stdin=subprocess.DEVNULL,
                        cwd=self.folder,
                        env={**os.environ, **own, "NO_COLOR": "1"},
                    )
                except (OSError, ValueError) as error:
                    return _answer(f"the command cannot run: {error}")
                async with process, anyio.create_task_group() as group:  # a cancelled one is killed
                    group.start_soon(_remarks, process.stderr, lines, report)
                    async for part in cast(Any, process.stdout):
                        out += part
                        if len(out) > LARGEST:
                            group.cancel_scope.cancel()
                            break
        said = "\n".join(lines)
        if scope.cancelled_caught:
            return _answer(f"no result within the limit of {self.limit:g} s\n{said}".rstrip())
        if len(out) > LARGEST:
            size = f"over {LARGEST / MEGABYTE:g} MB, the largest document that is sent"
            return _answer(f"{size}; ask for less, or run the command with --json")
        try:
            document = json.loads(out)
        except ValueError:
            return _answer(said or f"no document; exit status {process.returncode}")
        return _answer(said, document)


def _answer(said: str, document: dict[str, Any] | None = None) -> CallToolResult:
    """Return a document, or why there is none, as the SDK sends it; beside it, what was said."""
    from mcp.types import CallToolResult, TextContent

    error = document is None or document.get("taction", {}).get("schema", "").startswith("error")
    texts = [said] if document is None else filter(None, [json.dumps(document), said])
    content: Any = [TextContent(type="text", text=text) for text in texts]
    return CallToolResult(content=content, structured_content=document, is_error=error)


async def _remarks(stream: Any, lines: list[str], report: Callable[..., Any]) -> None:
    """Take the lines of stderr, and report each of them."""
    rest = b""
    async for part in stream:
        *whole, rest = (rest + part).split(b"\n")
        for line in whole:
            lines.append(line.decode(errors="replace").removeprefix("taction: "))
            await report(len(lines), None, lines[-1])
