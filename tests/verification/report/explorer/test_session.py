"""What a page is told, in which order, and who gets through to it, without a browser."""

from __future__ import annotations

import asyncio
import base64
import socket
from collections.abc import Callable, MutableMapping
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.loading import load_scene
from taction.system.errors import InputError
from taction.verification.design import exploration
from taction.verification.design.exploration import Start
from taction.verification.report.explorer import server
from taction.verification.report.explorer.server import Guard
from taction.verification.report.explorer.session import Session
from taction.verification.studies.running.study import WorkerDiedError
from tests.support.paths import SCENES

C = "design.capacitance"
TOKEN, PORT = "secret", 8080
HOST = f"127.0.0.1:{PORT}"
COOKIE = f"taction-{PORT}={TOKEN}"


class Here:
    """A job that runs in this process."""

    def __init__(self) -> None:
        self.calls = 0

    async def run(self, function: Callable[..., Any], *args: Any) -> Any:
        self.calls += 1
        return function(*args)


class Ended(Here):
    """A job whose process ends."""

    async def run(self, function: Callable[..., Any], *args: Any) -> Any:
        raise WorkerDiedError("the process was ended")


@pytest.fixture(autouse=True)
def strips(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """No verdicts along the sliders but in tests of them."""
    if "strips" not in request.node.name:
        monkeypatch.setattr(exploration, "spots", lambda *_: [])


def told(
    *moves: dict[str, Any], name: str = "paper-breadboard", job: Any = None, again: Any = None
) -> list[Any]:
    """Return the parts that a page is told of moves; the hand rests after the last one.

    `again` is a move after this rest.
    """
    parts: list[Any] = []

    async def run() -> None:
        start = Start.of(load_scene(SCENES / f"{name}.toml"))
        page = Session(start, parts.append, job or Here())  # type: ignore[arg-type]
        for move in (*moves, again):
            if move is None:
                continue
            if move is again and page.work is not None:
                await page.work
            page.move(move)
        if page.work is not None:
            await page.work

    asyncio.run(run())
    return parts


def curve(part: dict[str, Any], channel: int) -> tuple[np.ndarray, np.ndarray]:
    line = next(each for each in part["outputs"]["data"] if each["name"] == f"u{channel + 1}")
    x, y = (np.frombuffer(base64.b64decode(line[key]["bdata"]), dtype="<f4") for key in "xy")
    return x, y


def test_what_is_fast_comes_first_and_the_verdict_last() -> None:
    parts = told({})
    assert {"stress", "poles", "outputs", "values", "command"} <= set(parts[0])
    order = [next(k for k in ("outputs", "stable", "limits", "outcome") if k in p) for p in parts]
    assert order == ["outputs", "stable", "limits", "outcome"]
    assert parts[-1]["outcome"] == "pass"
    x, y = curve(parts[0], 3)
    verdict = taction.verify(SCENES / "paper-breadboard.toml", engine="statespace")
    expected = np.interp(x, verdict.waveforms.time, verdict.u[:, 3])
    assert y == pytest.approx(expected, abs=1e-3 * verdict.measurements.amplitude)


def test_only_the_newest_values_have_a_verdict() -> None:
    job = Here()
    parts = told(*({"places": {C: place}} for place in (600, 700, 800)), job=job)
    assert [part["number"] for part in parts if "outcome" in part] == [3]
    assert job.calls == 1


def test_strips_show_the_checks_along_every_slider(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine values of each; after a move of C the outcomes along C still hold, the others do not."""
    monkeypatch.setattr(exploration, "outcome_of", first := Stub())
    job = Here()
    parts = told({}, job=job, again={"places": {C: 600}})
    cells = [part["along"] for part in parts if "along" in part]
    assert all(len(found) == exploration.CELLS for found in cells[-1].values())
    assert {cell["outcome"] for found in cells[-1].values() for cell in found} == {"pass", "fail"}
    assert first.boards == 45 + 36
    begin = next(part for part in parts if part["number"] == 2)["along"]
    known = {path for path, found in begin.items() if found[0]["outcome"] != "unknown"}
    assert known == {C}


class Stub:
    """Verdicts that fail below 10 pF, and their number."""

    def __init__(self) -> None:
        self.boards = 0

    def __call__(self, scene: Any) -> tuple[str, str]:
        self.boards += 1
        return ("pass", "") if scene.design.capacitance >= 1e-11 else ("fail", "rise time")


@pytest.mark.parametrize(
    "move",
    [
        {"texts": {C: "1e-999"}},
        {"texts": {C: None}},
        {"texts": 5},
        {"places": {"design.colour": 3}},
        {"places": {C: "3"}},
        {"places": {C: 10**400}},
        {"places": {C: float("nan")}},
        {"places": []},
        {"places": {3: 3}},
        {"opamp": "none"},
        {"opamp": 3},
        {"reset": "yes"},
    ],
)
def test_wrong_values_change_nothing(move: dict[str, Any]) -> None:
    (part,) = told(move)
    assert part["mistake"]
    assert part["values"][C]["text"] == "10 pF"


def test_values_without_a_board_say_why() -> None:
    """The AD8065 works at ±12 V at most, and the board has ±15 V."""
    (part,) = told({"opamp": "ad8065"})
    assert "ad8065 works at supplies" in part["refused"]
    assert "--set design.opamp=ad8065" in part["command"]


def test_a_lost_process_is_no_verdict() -> None:
    assert told({}, job=Ended())[-1]["outcome"] == "error"


def simulated(*, cancel: bool) -> list[Any]:
    """Return the parts that a page is told while ngspice runs on its values."""
    parts: list[Any] = []

    async def run() -> None:
        page = Session(Start.of(load_scene(SCENES / "paper-breadboard.toml")), parts.append, Here())  # type: ignore[arg-type]
        page.move({})
        await page.work  # type: ignore[misc]
        page.simulate()
        await asyncio.sleep(0.1)
        if cancel:
            page.cancel()
        await page.simulation  # type: ignore[misc]

    asyncio.run(run())
    assert [part["simulating"] for part in parts if "simulating" in part] == [True, False]
    return parts


def test_ngspice_is_told_beside_the_state_space(ngspice: str) -> None:
    found = next(part for part in simulated(cancel=False) if "simulation" in part)
    assert ": pass in " in found["simulation"]
    names = [each["name"] for each in found["outputs"]["data"]]
    assert names.count("ngspice") == 7


def test_a_run_of_ngspice_ends_when_it_is_cancelled() -> None:
    assert not any("simulation" in part for part in simulated(cancel=True))


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.socket() as taken:
        taken.bind((server.HOST, 0))
        taken.listen()
        with pytest.raises(InputError, match="--port"):
            server.bound(taken.getsockname()[1])


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
