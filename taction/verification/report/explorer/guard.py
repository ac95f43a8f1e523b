"""Who may read the page: only a browser that came with the token, under the page's own name.

The server listens on the loopback interface, which every user of the machine reaches, and with a
name that resolves to it (DNS rebinding) every page of the web does. So each request needs the token
of the printed address, or the cookie that the browser had for it; its Host must be the server's,
and its Origin, if it has one, too: that of another port is another server.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

HOST = "127.0.0.1"
REFUSED = b"403: open the address that `taction explore` printed\n"
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self'"
    " 'unsafe-inline'; img-src 'self' data:; font-src 'self' data:; connect-src 'self'"
    " ws://{host}; object-src 'none'; base-uri 'none'; frame-ancestors 'none'; form-action 'none'"
)
"""NiceGUI compiles its templates in the page, which needs the two words in quotes."""

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]


class Guard:
    """An ASGI application that lets only the owner of `token` through to `app`."""

    def __init__(self, app: App, token: str, port: int) -> None:
        self.app, self._token, self._port = app, token, port
        self._cookie = f"taction-{port}"
        self._hosts = {f"{HOST}:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer one request, or one websocket."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {key.decode("latin-1"): v.decode("latin-1") for key, v in scope["headers"]}
        host = headers.get("host", "")
        names = [key for key, _ in scope["headers"]]
        single = all(names.count(name) <= 1 for name in (b"host", b"origin"))
        if not single or not self._is_ours(headers, host):
            await _refuse(scope, send)
        elif self._has_token(scope):
            await self._admit(send)
        elif self._is_same(self._cookie_of(headers)):
            await self.app(scope, receive, _with_policy(send, host))
        else:
            await _refuse(scope, send)

    def _is_ours(self, headers: dict[str, str], host: str) -> bool:
        origin = headers.get("origin")
        return host in self._hosts and (origin is None or origin == f"http://{host}")

    def _is_same(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    def _has_token(self, scope: Message) -> bool:
        if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != "/":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])
        return self._is_same(given[0])

    def _cookie_of(self, headers: dict[str, str]) -> str:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(self._cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value

    async def _admit(self, send: Send) -> None:
        """Give the cookie, and leave the token out of the browser's address line."""
        cookie = f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        headers = [
            (b"location", b"/"),
            (b"set-cookie", cookie.encode()),
            (b"referrer-policy", b"no-referrer"),
            (b"cache-control", b"no-store"),
        ]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


def _with_policy(send: Send, host: str) -> Send:
    """Return `send` with headers that let the browser load from this server alone."""
    policy = POLICY.format(host=host)

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [
                *message.get("headers", []),
                (b"content-security-policy", policy.encode()),
                (b"referrer-policy", b"no-referrer"),
                (b"x-content-type-options", b"nosniff"),
            ]
        await send(message)

    return sending


async def _refuse(scope: Message, send: Send) -> None:
    if scope["type"] == "websocket":  # a server answers a websocket that is not accepted with 403
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain"), (b"content-length", str(len(REFUSED)).encode())]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": REFUSED})
