"""The page of the explorer on the loopback interface, by NiceGUI."""

from __future__ import annotations

import asyncio
import functools
import gc
import importlib.util
import json
import os
import secrets
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError
from taction.verification.design.explorer_settings import Start
from taction.verification.report.explorer.guard import HOST, Guard
from taction.verification.report.explorer.parts import Part, start_part
from taction.verification.report.explorer.session import ExplorerJob, Session
from taction.verification.report.renderers.page import FILES as PAGE_FILES
from taction.verification.report.renderers.page import templates

if TYPE_CHECKING:
    from jinja2 import Environment

PACKAGES = {"nicegui": "NiceGUI", "plotly": "Plotly"}
REMEDY = "the explorer needs {}: pip install 'taction[explore]'"
PAGE = Path(__file__).parent / "page"
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
SENT = ("refused", "simulating")  # what the program of the page needs beside the markup
AGAIN = 0.02  # s between two looks whether the server listens
HEAD = (
    '<link rel="stylesheet" href="/taction/explorer.css">'
    '<script src="/plotly/plotly.min.js"></script>'
    '<script src="/report/charts.js"></script>'
    '<script type="module" src="/taction/explorer.js"></script>'
)


def check_explorer() -> None:
    """Refuse with InputError an exploration without its packages, before any work is done."""
    missing = [name for key, name in PACKAGES.items() if importlib.util.find_spec(key) is None]
    if missing:
        raise InputError("explore", Complaint("", "", REMEDY.format(" and ".join(missing))))


def free_port(wanted: int) -> int:
    """Return `wanted`, or any free port for 0; InputError where another program has the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, wanted))
        except OSError as error:
            text = f"{error.strerror}; expected a free port, or no --port for any"
            raise InputError("--port", Complaint("PORT", repr(wanted), text)) from None
        return int(probe.getsockname()[1])


def has_display() -> bool:
    """Whether a browser could show the page on this machine."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in DISPLAYS)


def explore(scene: Scene, *, port: int, show: bool, announce: Callable[[str], None]) -> None:
    """Serve the explorer of `scene` until Ctrl-C.

    `port` is 0 for any free one; `show` opens a browser where there is a display; `announce` takes
    the address once the page can be opened. InputError or SolverError: the scene cannot be used,
    NiceGUI is missing, or the port is taken.
    """
    check_explorer()
    start = Start.of(scene)
    port, token = free_port(port), secrets.token_urlsafe(32)
    address = f"http://{HOST}:{port}/?token={token}"
    os.environ.setdefault("NICEGUI_STORAGE_PATH", os.devnull)  # nothing is stored
    import uvicorn
    from nicegui import app, ui

    jobs: list[ExplorerJob] = []
    waiting: list[asyncio.Task[None]] = []

    async def begin() -> None:
        jobs.extend((ExplorerJob(), ExplorerJob()))
        waiting.append(asyncio.create_task(open_to_all()))

    async def open_to_all() -> None:
        await _listening(port)
        announce(address)
        if show and has_display():
            await asyncio.to_thread(webbrowser.open, address)
        await jobs[0].warm_up()
        gc.freeze()  # a collection that visits all imported modules takes longer than a move

    def end() -> None:
        for job in jobs:
            job.close()

    app.on_startup(begin)
    app.on_shutdown(end)
    app.add_static_files("/taction", str(PAGE))
    app.add_static_files("/plotly", str(files("plotly") / "package_data"))
    app.add_static_files("/report", str(PAGE_FILES))
    ui.page("/", title=f"taction explore {scene.name}")(lambda: _open_page(start, jobs))
    app.add_middleware(Guard, token=token, port=port)
    hangup = getattr(signal, "SIGHUP", None)  # unknown on some systems
    if hangup is not None and signal.getsignal(hangup) is not signal.SIG_IGN:
        known = uvicorn.server.HANDLED_SIGNALS
        uvicorn.server.HANDLED_SIGNALS = (*dict.fromkeys((*known, hangup)),)
    ui.run(
        host=HOST,
        port=port,
        binding_refresh_interval=None,  # nothing on the page is bound
        reload=False,
        show=False,
        show_welcome_message=False,
        favicon="〰",
        language="en-US",
        gzip_middleware_factory=None,
        uvicorn_logging_level="error",
        timeout_graceful_shutdown=1,
    )


async def _listening(port: int) -> None:
    """Wait until the server, which starts after its start-up functions, accepts connections."""
    while True:
        try:
            _, writer = await asyncio.open_connection(HOST, port)
        except OSError:
            await asyncio.sleep(AGAIN)
        else:
            writer.close()
            return


def _open_page(start: Start, jobs: list[ExplorerJob]) -> None:
    """Build the page of one browser tab."""
    from nicegui import ui

    client = ui.context.client

    def send(part: Part) -> None:
        if client.has_socket_connection:
            told = json.dumps(markup_of(part), allow_nan=False)
            client.run_javascript(f"window.taction?.({told})")

    session = Session(start, send, jobs[0], jobs[1])
    ui.add_head_html(HEAD)
    page = _templates().get_template("explorer.html").render(start=start_part(start))
    ui.html(page, sanitize=False)

    async def ready() -> None:
        await session.move({})

    async def move(event: Any) -> None:
        await session.move(_mapping(event.args))

    async def simulate() -> None:
        await session.simulate()

    ui.on("taction-ready", ready)
    ui.on("taction-move", move)
    ui.on("taction-window", lambda event: session.show(str(event.args)))
    ui.on("taction-simulate", simulate)
    ui.on("taction-cancel", session.cancel)
    ui.on("taction-save", lambda event: session.save(str(event.args)))


@functools.cache
def _templates() -> Environment:
    return templates(PAGE)


def markup_of(part: Part) -> Part:
    """Return a part for the browser: its texts as markup, by the macros of their names."""
    macros: Any = _templates().get_template("parts.html").module
    shown = {key: getattr(macros, key, None) for key in part}
    kept = {key: value for key, value in part.items() if shown[key] is None or key in SENT}
    if "verdict" in part:
        kept["outcome"] = part["verdict"]["outcome"]
    kept["html"] = "".join(macro(part[key]) for key, macro in shown.items() if macro is not None)
    return kept


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}
