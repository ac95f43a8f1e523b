"""What a page is told, in which order, and who gets through to it, without a browser."""

from __future__ import annotations

import asyncio
import base64
import socket
from collections.abc import Callable, MutableMapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import InputError
from taction.system.quantities import spaced
from taction.verification.design import exploration
from taction.verification.design.exploration import Settings
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


def told(
    *moves: dict[str, Any], job: Any = None, simulates: bool = False, strips: bool = False
) -> list[Any]:
    """Return the parts that a page is told of moves; the hand rests after the last one."""
    parts: list[Any] = []

    async def run() -> None:
        settings = Settings.of(load_scene(SCENES / "paper-breadboard.toml"))
        page = Session(settings, parts.append, job or Here())  # type: ignore[arg-type]
        for move in moves:
            page.move(move)
        if page.work is not None:
            await page.work
            if page.strips is not None and strips:
                await page.strips
            elif page.strips is not None:
                page.strips.cancel()
            if simulates:
                page.simulate()
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


def test_strips_show_the_checks_along_every_slider(monkeypatch: pytest.MonkeyPatch) -> None:
    def outcome(scene: Scene) -> tuple[str, str]:
        return ("pass", "all") if scene.design.capacitance >= 1e-11 else ("fail", "stability")

    monkeypatch.setattr(exploration, "outcome_of", outcome)
    job = Here()
    first, *_, last = (part for part in told({}, job=job, strips=True) if "along_0" in part)
    assert {outcome for outcome, _ in first["along_0"]} == {"unknown"}
    assert [outcome for outcome, _ in last["along_0"]] == ["fail"] * 4 + ["pass"] * 5
    assert last["along_0"][0][1].endswith(": stability")
    assert {each for n in range(1, 5) for each, _ in last[f"along_{n}"]} == {"pass"}
    assert job.calls == 1 + 5 * 9 - 2  # three strips have the scene's own value in the middle


def test_the_outcome_of_a_strip_is_that_of_the_command() -> None:
    scene = load_scene(SCENES / "paper-breadboard.toml")
    assert exploration.outcome_of(scene) == ("pass", "all checks pass")
    smaller = with_values(scene, {C: 8.2e-12})
    verdict = taction.verify(smaller, engine="statespace")
    failed = [check.name for check in verdict.checks if check.outcome.value != "pass"]
    assert exploration.outcome_of(smaller) == ("fail", ", ".join(map(spaced, failed)))


def test_only_the_newest_values_have_a_verdict() -> None:
    job = Here()
    parts = told(*({"places": {C: place}} for place in (600, 700, 800)), job=job)
    assert [part["number"] for part in parts if "outcome" in part] == [3]
    assert job.calls == 1
    (note,) = (part["poles"]["note"] for part in parts if "poles" in part)
    assert "; the rightmost ringing pole's frequency is 37.26 kHz" in note  # the rightmost is real


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


def test_the_saved_scene_has_the_values(tmp_path: Path) -> None:
    parts, file = list[Any](), tmp_path / "explored.toml"
    settings = Settings.of(load_scene(SCENES / "lasso.toml")).moved({C: 12e-12}, "tl084")
    Session(settings, parts.append, Here()).save()  # type: ignore[arg-type]
    file.write_text(parts[-1]["scene"], encoding="utf-8")
    assert load_scene(file).design.capacitance == 12e-12
    assert load_scene(file).model_dump() == settings.scene().model_dump()


def test_ngspice_judges_the_values_when_it_is_asked_to(ngspice: str) -> None:
    *_, own, simulated = told({}, simulates=True)
    assert own["outcome"] == simulated["outcome"] == "pass"
    named = [[bar.name for bar in part["checks"].rows] for part in (own, simulated)]
    assert named[1] == [*named[0], "engines agree"]


def test_a_lost_process_is_no_verdict() -> None:
    assert told({}, job=Ended())[-1]["outcome"] == "error"


def test_a_port_that_is_taken_is_refused() -> None:
    refused = pytest.raises(InputError, match="--port")
    with socket.create_server((server.HOST, 0)) as taken, refused:
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


def test_the_token_becomes_the_cookie_that_opens_the_page_with_its_policy() -> None:
    first = answer(query=f"token={TOKEN}")
    headers = dict(first["headers"])
    assert first["status"] == 303
    assert headers[b"location"] == b"/"
    assert headers[b"set-cookie"].startswith(COOKIE.encode())
    assert b"HttpOnly" in headers[b"set-cookie"]
    assert b"samesite=strict" in headers[b"set-cookie"].lower()
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
def test_a_wrong_token_opens_nothing_and_the_token_the_page_alone(query: str) -> None:
    assert answer(query=query)["status"] == 403
    assert answer(path="/taction/explorer.js", query=f"token={TOKEN}")["status"] == 403
    assert answer("websocket", query=f"token={TOKEN}")["type"] == "websocket.close"
