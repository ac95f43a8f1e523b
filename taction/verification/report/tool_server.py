"""Tools for programs, over the Model Context Protocol: verify, check, onset, netlist, models, diff.

Each call runs the command in a process of its own, with ``--json``: what a program gets is the
document that the command prints, and the arguments are those that the command takes. The process
reads files of the server's folder only, has a time limit, and leaves nothing behind.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from taction.system.errors import Complaint, InputError, NoVerdictError
from taction.system.foreign_files import FOLDERS, MEGABYTE
from taction.system.foreign_text import shortened
from taction.system.processes import guard

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server

PACKAGE = "the server needs the SDK of MCP: pip install 'taction[mcp]'"
ABOUT = (
    "taction verifies analog boards (scenes, .toml) and checks SPICE decks. Names of files are"
    " relative to the folder of the server, and files outside of it are not read. A result is the"
    " document of the command's --json, in SI units, with a bound beside each number; its `outcome`"
    " is pass, fail or inconclusive."
)
PROCESSES = 2  # that run at once
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
PATIENCE = 3.0  # s from SIGTERM to SIGKILL
LARGEST = 64 * MEGABYTE  # bytes of a document
ASKING = "expected a program that asks over stdin"
TYPES = {"integer": "integer", "number": "number", "boolean": "boolean"}  # others are strings


@dataclass(frozen=True, slots=True)
class Tool:
    """A command as a tool: its words, and the options that a program may give."""

    command: str
    options: tuple[str, ...] = ()


TOOLS = {
    "verify": Tool("verify", ("engine", "settings", "margins", "changes")),
    "check": Tool("check", ("outputs", "checks", "expect", "over", "ngspice")),
    "onset": Tool("onset", ("over", "transients")),
    "netlist": Tool("netlist", ("dialect", "parameters", "measure")),
    "diff": Tool("diff", ("engine", "agree")),
    "models": Tool("parts"),
    "model": Tool("parts show"),
}
"""By the name of the tool. None of them writes a file."""


@cache
def commands() -> dict[str, dict[str, Any]]:
    """Return the commands behind the tools, as ``taction COMMAND --help --json`` has them."""
    names = dict.fromkeys(tool.command.split()[0] for tool in TOOLS.values())
    line = [sys.executable, "-P", "-m", "taction", *names, "--help", "--json"]
    found = json.loads(subprocess.run(line, capture_output=True, check=True).stdout)
    known = {each["name"]: each for each in found["commands"]}
    return {name: known[tool.command] for name, tool in TOOLS.items()}


@dataclass(frozen=True, slots=True)
class Tools:
    """The tools of a folder.

    Attributes
    ----------
    folder : Path
        What the files of a call are relative to; files outside of it are not read.
    limit : float
        Of a call, s.
    """

    folder: Path
    limit: float

    def schema(self, name: str) -> dict[str, Any]:
        """Return the JSON schema of a tool's arguments."""
        command, wanted = commands()[name], TOOLS[name].options
        parameters = command["arguments"] + [o for o in command["options"] if o["name"] in wanted]
        return {
            "type": "object",
            "properties": {each["name"]: _property(each) for each in parameters},
            "required": [each["name"] for each in parameters if each["required"]],
            "additionalProperties": False,
        }

    def words(self, name: str, given: Mapping[str, Any]) -> list[str]:
        """Return the command line of a call, without the program."""
        command = commands()[name]
        made = [*TOOLS[name].command.split(), "--json"]
        for option in command["options"]:
            if option["name"] in given:
                made += _option(option, given[option["name"]])
        made.append("--")
        for argument in command["arguments"]:
            value = given.get(argument["name"], [])
            made += map(str, value) if isinstance(value, list) else [str(value)]
        return made

    async def call(
        self, name: str, given: Mapping[str, Any], told: Callable[[str], Any]
    ) -> tuple[dict[str, Any] | None, str, bool]:
        """Run a call.

        Parameters
        ----------
        name : str
            Key of `TOOLS`.
        given : mapping
            Arguments that `schema` accepts.
        told : callable
            Awaited with each line of progress.

        Returns
        -------
        dict or None, str, bool
            The document; what the command said beside it, or why there is none; whether there is no
            result.
        """
        import anyio

        out, lines, status = bytearray(), list[str](), None
        with tempfile.TemporaryDirectory() as place:
            line = [*guard(), sys.executable, "-P", "-m", "taction", *self.words(name, given)]
            folders = json.dumps([str(self.folder), place])
            own = {FOLDERS: folders, "TMPDIR": place, "NO_COLOR": "1"}
            try:
                process = await anyio.open_process(
                    line,
                    stdin=subprocess.DEVNULL,
                    cwd=self.folder,
                    env={**os.environ, **own},
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                return None, f"the command cannot run: {error}", True
            try:
                with anyio.move_on_after(self.limit):
                    async with anyio.create_task_group() as group:
                        group.start_soon(_remarks, process.stderr, lines, told)
                        await _take(process.stdout, out)
                        if len(out) > LARGEST:
                            group.cancel_scope.cancel()
                    status = -1 if len(out) > LARGEST else await process.wait()
            finally:
                with anyio.CancelScope(shield=True):
                    await _end(process)
        if status is None:
            said = "".join(f"\n{line}" for line in lines)
            return None, f"no result within the limit of {self.limit:g} s{said}", True
        if len(out) > LARGEST:
            size = f"over {LARGEST / MEGABYTE:g} MB, the largest document that is sent"
            return None, f"{size}; ask for less, or run the command with --json", True
        try:
            document = json.loads(out)
        except ValueError:
            return None, "\n".join(lines) or f"no document; exit status {status}", True
        failed = document.get("taction", {}).get("schema", "").startswith("error")
        return document, "\n".join(lines), failed


def serve(folder: str | Path, limit: float) -> None:
    """Answer calls over stdin and stdout until stdin ends.

    Raises
    ------
    InputError
        See `server`; or nothing can be read from stdin.
    NoVerdictError
        Stdout takes no more.
    """
    if not (math.isfinite(limit) and limit > 0.0):
        expected = "expected a finite number of seconds above zero"
        raise InputError("--limit", Complaint("SECONDS", repr(limit), expected))
    made = server(folder, limit)
    if sys.stdin is None:
        raise InputError("mcp", Complaint("stdin", "", f"closed; {ASKING}"))
    import anyio
    from mcp.server.stdio import stdio_server

    handlers = _ending_handlers()
    received: list[int] = []

    async def end(scope: anyio.CancelScope) -> None:
        with anyio.open_signal_receiver(*handlers) as signals:
            async for number in signals:
                received.append(number)
                scope.cancel()

    async def run() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(end, group.cancel_scope)
            async with stdio_server(cast(Any, _Lines())) as (read, write):
                await made.run(read, write, made.create_initialization_options())
            group.cancel_scope.cancel()

    try:
        anyio.run(run)
    except BaseExceptionGroup as group:  # of the tasks that read, answer and write
        error = _first(group)
        if isinstance(error, BrokenPipeError) or not isinstance(error, OSError):
            raise error from None
        raise NoVerdictError(f"stdout cannot be written: {error.strerror}") from None
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if received:
        signal.raise_signal(received[0])  # everything has ended; now as of every command


def _ending_handlers() -> dict[signal.Signals, Any]:
    """Return the handlers of signals that end a command; an error inside a task would be lost."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    known = {each: signal.getsignal(each) for each in signal.Signals if each.name in ENDING}
    return {number: handler for number, handler in known.items() if callable(handler)}


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


def _first(error: BaseException) -> BaseException:
    """Return the first error of a group that is no group."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def server(folder: str | Path, limit: float) -> Server[Any]:
    """Return the server of the tools in a folder.

    Raises
    ------
    InputError
        There is no such folder, or the SDK is missing.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError(folder, Complaint("FOLDER", repr(str(folder)), "expected a folder"))
    try:
        import jsonschema
        from mcp import types
        from mcp.server.lowlevel import Server
    except ImportError:
        raise InputError("mcp", Complaint("FOLDER", repr(str(folder)), PACKAGE)) from None
    import anyio

    tools = Tools(place.resolve(), limit)
    slots = anyio.CapacityLimiter(PROCESSES)

    async def listed(context: Any, given: Any) -> Any:
        known = await anyio.to_thread.run_sync(commands)
        return types.ListToolsResult(
            tools=[
                types.Tool(
                    name=name, description=known[name]["help"], input_schema=tools.schema(name)
                )
                for name in TOOLS
            ]
        )

    async def called(context: Any, given: Any) -> Any:
        arguments = given.arguments or {}
        if given.name not in TOOLS:
            return _answer(
                None, f"no tool {given.name!r}; expected one of {', '.join(TOOLS)}", True
            )
        await anyio.to_thread.run_sync(commands)
        try:
            jsonschema.validate(arguments, tools.schema(given.name))
        except jsonschema.ValidationError as error:
            key = ".".join(map(str, error.absolute_path)) or "arguments"
            return _answer(None, shortened(f"{given.name}: {key}: {error.message}"), True)
        count = 0

        async def told(line: str) -> None:
            nonlocal count
            count += 1
            await context.session.report_progress(count, None, line)

        async with slots:
            return _answer(*await tools.call(given.name, arguments, told))

    def _answer(document: dict[str, Any] | None, said: str, failed: bool) -> Any:
        texts = [said] if document is None else [json.dumps(document), *([said] if said else [])]
        return types.CallToolResult(
            content=[types.TextContent(type="text", text=text) for text in texts],
            structured_content=document,
            is_error=failed,
        )

    return Server(
        "taction",
        version=metadata.version("taction"),
        instructions=ABOUT,
        on_list_tools=listed,
        on_call_tool=called,
    )


def _property(parameter: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of one argument or option."""
    made: dict[str, Any] = {"type": TYPES.get(parameter["type"], "string")}
    if parameter["type"] == "choice":
        made["enum"] = parameter["choices"]
    made |= {
        word: parameter[key]
        for key, word in (("min", "minimum"), ("max", "maximum"))
        if parameter.get(key) is not None
    }
    if parameter["several"]:
        made = {"type": "array", "items": made, "minItems": int(parameter["required"])}
    form = f" ({parameter['metavar']})" if parameter.get("metavar") else ""
    about = parameter.get("help") or f"{parameter['name']}: a file of the server's folder"
    return made | {"description": f"{about}{form}"}


def _option(option: Mapping[str, Any], value: Any) -> Iterator[str]:
    """Yield an option as words of a command line."""
    flag = next(each for each in option["flags"] if each.startswith("--"))
    if option["is_flag"]:
        against = [each for each in option["flags"] if each.startswith("--no-")]
        yield from [flag] if value else against
        return
    for each in value if isinstance(value, list) else [value]:
        yield f"{flag}={each}"


async def _take(stream: Any, out: bytearray) -> None:
    """Take what a stream gives, up to a part more than `LARGEST`."""
    async for part in stream:
        out += part
        if len(out) > LARGEST:
            return


async def _remarks(stream: Any, lines: list[str], told: Callable[[str], Any]) -> None:
    """Take the lines of stderr, and tell each of them."""
    rest = b""
    async for part in stream:
        *whole, rest = (rest + part).split(b"\n")
        for line in whole:
            text = line.decode(errors="replace").removeprefix("taction: ")
            lines.append(text)
            await told(text)


async def _end(process: Any) -> None:
    """End a process with all that it started."""
    import anyio

    for number in (signal.SIGTERM, signal.SIGKILL):
        if process.returncode is not None:
            break
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        with anyio.move_on_after(PATIENCE):
            await process.wait()
    await process.aclose()
