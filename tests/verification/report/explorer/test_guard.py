"""Who gets through to the page: only who has the token, by the page's own name."""

from __future__ import annotations

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

from taction.verification.report.explorer.server import Guard

TOKEN, PORT = "secret", 8080
HOST = f"127.0.0.1:{PORT}"
COOKIE = f"taction-{PORT}={TOKEN}"


def answer(
    kind: str = "http",
    path: str = "/",
    query: str = "",
    again: tuple[tuple[str, str], ...] = (),
    **headers: str,
) -> dict[str, Any]:
    """Send one request; return the first message of the answer, or that the page was reached."""
    sent: list[MutableMapping[str, Any]] = []

    async def page(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> MutableMapping[str, Any]:
        return {}

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message)

    given = {"host": HOST, **headers}
    scope = {
        "type": kind,
        "method": "GET",
        "path": path,
        "query_string": query.encode(),
        "headers": [(key.encode(), value.encode()) for key, value in (*given.items(), *again)],
    }
    asyncio.run(Guard(page, TOKEN, PORT)(scope, receive, send))
    return dict(sent[0])


def test_the_token_becomes_a_cookie() -> None:
    first = answer(query=f"token={TOKEN}")
    headers = dict(first["headers"])
    assert first["status"] == 303
    assert headers[b"location"] == b"/"
    assert headers[b"set-cookie"].startswith(COOKIE.encode())
    assert b"HttpOnly" in headers[b"set-cookie"]
    assert b"samesite=strict" in headers[b"set-cookie"].lower()


def test_the_cookie_opens_the_page_with_its_policy() -> None:
    first = answer(cookie=COOKIE)
    assert first["status"] == 200
    policy = dict(first["headers"])[b"content-security-policy"].decode()
    assert policy.startswith("default-src 'self';")
    assert "http:" not in policy


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"cookie": f"taction-{PORT}=wrong"},
        {"cookie": f"taction-1={TOKEN}"},
        {"cookie": "\x00;;="},
        {"cookie": COOKIE, "host": "evil.example"},
        {"cookie": COOKIE, "host": "127.0.0.1:9"},
        {"cookie": COOKIE, "origin": "http://127.0.0.1:9"},
        {"cookie": COOKIE, "origin": "null"},
    ],
)
def test_everybody_else_is_refused(kind: str, headers: dict[str, str]) -> None:
    first = answer(kind, **headers)
    assert first.get("status") == 403 or first["type"] == "websocket.close"


@pytest.mark.parametrize("name", ["host", "origin"])
def test_two_hosts_or_origins_are_refused(name: str) -> None:
    more = f"http://{HOST}" if name == "origin" else HOST
    headers = {"cookie": COOKIE, name: more}
    assert answer(**headers)["status"] == 200
    assert answer(again=((name, more),), **headers)["status"] == 403
    assert answer("websocket", again=((name, more),), **headers)["type"] == "websocket.close"


@pytest.mark.parametrize("query", ["token=wrong", "token=", "", "token=" + "é"])
def test_a_wrong_token_is_refused(query: str) -> None:
    assert answer(query=query)["status"] == 403


def test_the_token_opens_nothing_but_the_page() -> None:
    assert answer(path="/taction/explorer.js", query=f"token={TOKEN}")["status"] == 403
    assert answer("websocket", query=f"token={TOKEN}")["type"] == "websocket.close"
