"""The page of the explorer on the loopback interface, and who may read it.

The server listens on the loopback interface, which every user of the machine reaches, and with a
name that resolves to it (DNS rebinding) every page of the web does. So each request needs the token
of the printed address, or the cookie that the browser had for it; its Host must be the server's,
and its Origin, if it has one, too: that of another port is another server.
"""

from __future__ import annotations

import asyncio
import gc
import hmac
import json
import os
import secrets
import signal
import socket
import sys
import webbrowser
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError
from taction.system.output_files import check_extra
from taction.verification.design.exploration import Settings
from taction.verification.report.explorer.page_parts import Part, start_part
from taction.verification.report.explorer.session import ExplorerJob, Session
from taction.verification.report.renderers.page import FILES as PAGE_FILES
from taction.verification.report.renderers.page import templates

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Send

HOST = "127.0.0.1"
REFUSED = "403: open the address that `taction explore` printed\n"
POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src"
    " 'self' ws://{host}; object-src 'none'; base-uri 'none'; frame-ancestors 'none';"
    " form-action 'none'"
)

ADMITTED = {"referrer-policy": "no-referrer", "cache-control": "no-store"}


class Guard:
    """An ASGI application that lets only the owner of `token` through to `app`."""

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self.app, self._token, self._cookie = app, token, f"taction-{port}"
        self._hosts = (f"{HOST}:{port}", f"localhost:{port}")

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer one request, or one websocket."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        from starlette.requests import HTTPConnection
        from starlette.responses import PlainTextResponse, RedirectResponse, Response

        asked = HTTPConnection(scope)
        hosts, origins = (asked.headers.getlist(name) for name in ("host", "origin"))
        ours = len(hosts) == 1 and hosts[0] in self._hosts
        ours = ours and origins in ([], [f"http://{hosts[0]}"])
        if ours and self._is_same(asked.cookies.get(self._cookie, "")):
            await self.app(scope, receive, _with_policy(send, hosts[0]))
        elif scope["type"] == "websocket":  # a server answers one that is not accepted with 403
            await send({"type": "websocket.close", "code": 1008})
        else:
            answer: Response = PlainTextResponse(REFUSED, 403)
            begins = (scope["method"], scope["path"]) == ("GET", "/")
            if ours and begins and self._is_same(asked.query_params.get("token", "")):
                answer = RedirectResponse("/", 303, ADMITTED)  # without the token in the address
                answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict")
            await answer(scope, receive, send)

    def _is_same(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())


def _with_policy(send: Send, host: str) -> Send:
    """Return `send` with headers that let the browser load from this server alone."""
    more = {
        b"content-security-policy": POLICY.format(host=host).encode(),
        b"referrer-policy": b"no-referrer",
        b"x-content-type-options": b"nosniff",
    }

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *more.items()]
        await send(message)

    return sending


PAGE = Path(__file__).parent / "page"


def bound(wanted: int) -> socket.socket:
    """Return a socket that listens on a port, or on any free one for 0; InputError: it is taken."""
    try:
        return socket.create_server((HOST, wanted))
    except OSError as error:
        text = f"{error.strerror}; expected a free port, or no --port for any"
        raise InputError("--port", Complaint("PORT", repr(wanted), text)) from None


def explore(scene: Scene, *, port: int, show: bool, announce: Callable[[str], None]) -> None:
    """Serve the explorer of `scene` until Ctrl-C.

    `port` is 0 for any free one; `show` opens a browser where there is a display; `announce` takes
    the address once the page can be opened. InputError or SolverError: the scene cannot be used,
    a package is missing, or the port is taken.
    """
    check_extra("explore", "explore")
    settings = Settings.of(scene)
    listening, token = bound(port), secrets.token_urlsafe(32)
    port = listening.getsockname()[1]
    address = f"http://{HOST}:{port}/?token={token}"
    import uvicorn
    from starlette.applications import Starlette
    from starlette.responses import HTMLResponse
    from starlette.routing import Mount, Route, WebSocketRoute
    from starlette.staticfiles import StaticFiles

    judging = ExplorerJob()

    async def page(request: object) -> HTMLResponse:
        return HTMLResponse(
            templates(PAGE).get_template("explorer.html").render(start_part(settings))
        )

    async def open_to_all() -> None:
        announce(address)  # a browser that is faster than the server waits
        display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if show and (display or sys.platform in ("darwin", "win32")):
            await asyncio.to_thread(webbrowser.open, address)
        await judging.warm_up()
        gc.freeze()  # a collection that visits all imported modules takes longer than a move

    @asynccontextmanager
    async def serving(app: object) -> AsyncIterator[None]:
        opening = asyncio.create_task(open_to_all())
        yield
        opening.cancel()
        judging.stop()

    places = {"/taction": PAGE, "/plotly": files("plotly") / "package_data", "/report": PAGE_FILES}
    mounts = (Mount(path, StaticFiles(directory=str(place))) for path, place in places.items())
    talk = WebSocketRoute("/talk", lambda socket: _talk(socket, settings, judging))
    routes = [Route("/", page), talk, *mounts]
    app = Guard(Starlette(routes=routes, lifespan=serving), token, port)
    hangup = getattr(signal, "SIGHUP", None)  # unknown on some systems
    if hangup is not None and signal.getsignal(hangup) is not signal.SIG_IGN:
        known = uvicorn.server.HANDLED_SIGNALS
        uvicorn.server.HANDLED_SIGNALS = (*dict.fromkeys((*known, hangup)),)
    server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=1))
    with listening, suppress(KeyboardInterrupt):
        server.run(sockets=[listening])


async def _talk(socket: Any, settings: Settings, judging: ExplorerJob) -> None:
    """Answer the page of one browser tab until it is closed."""
    told = asyncio.Queue[Part]()
    session = Session(settings, told.put_nowait, judging)

    async def tell() -> None:
        while True:
            await socket.send_text(json.dumps(markup_of(await told.get()), allow_nan=False))

    await socket.accept()
    telling = asyncio.create_task(tell())
    actions: dict[str, Callable[[Any], None]] = {
        "move": session.move,
        "window": lambda name: session.show(str(name)),
        "save": lambda _: session.save(),
        "simulate": lambda _: session.simulate(),
    }
    try:
        async for kind, given in socket.iter_json():
            actions[kind](given)
    finally:
        telling.cancel()
        session.close()


PLACES = ("command", "doubts", "limits", "facts", "stable", "stable_text", "verdict_text", "checks",
          "readings", "warnings")  # fmt: skip
"""Parts that are shown as markup, by the name of their element."""


def markup_of(part: Part) -> Part:
    """Return a part for the browser: its texts as markup, the others for the page's program."""
    macros: Any = templates(PAGE).get_template("macros.html").module
    own = {key for key in part if key in PLACES or key.startswith("along_")}
    kept = {key: value for key, value in part.items() if key not in own}
    shown = {key.replace("_", "-"): part[key] for key in part if key in own}
    if "refused" in part:
        shown |= {"refused": [part["refused"]], "verdict-text": "no board with these values"}
    if "refused" in part or "outcome" in part:
        shown["verdict-mark"] = part.get("outcome", "error")
    return kept | {"html": "".join(macros.into(*each) for each in shown.items())}
