"""One open page: the values under the hand, and what the page is told, what is fast first.

The page sends values and waits for their curves before it sends more, so nothing queues up. What is
slow runs in processes of its own, and is dropped where the values have moved on in the meantime.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from taction.system.documents import read
from taction.system.errors import EngineError, InputError, TactionError
from taction.system.quantities import readable
from taction.verification.design.exploration import (
    STEPS,
    Judgement,
    Settings,
    Start,
    judge,
    others,
    outcome_of,
    read_value,
    spots,
    view_boundary,
)
from taction.verification.report.explorer.page_parts import (
    Part,
    SliderLook,
    along_part,
    boundary_part,
    look_at,
    settings_part,
    simulation_part,
    verdict_part,
)
from taction.verification.stability.edges import Edges
from taction.verification.studies.running.pool import Worker, WorkerDiedError
from taction.verification.verdict.record import ERROR

T = TypeVar("T")
Send = Callable[[Part], None]
Stage = Callable[[], Part]
REST = 0.12  # s without new values, after which the hand rests
WINDOWS = ("rise", "whole")
SLOW = 2.0  # s of a verdict, above which the sliders show no checks
PATIENCE = 3.0  # s that a verdict on values that have moved on may still take


@dataclass(frozen=True, slots=True)
class Move:
    """What a page asks for: places of sliders from 0 to `STEPS`, typed texts, an op-amp."""

    places: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    opamp: str | None = None
    reset: bool = False


class ExplorerJob:
    """Calls in one process; a call that is ended raises `WorkerDiedError`."""

    def __init__(self) -> None:
        self._worker, self._began = Worker(), 0.0
        self._owner: object = None  # of the running call
        self._turn = asyncio.Lock()

    def seconds(self, owner: object) -> float:
        """For how long a call of `owner` has been running, s; 0 if none is."""
        return time.monotonic() - self._began if self._began and self._owner is owner else 0.0

    async def run(
        self, owner: object, wanted: Callable[[], bool], function: Callable[..., T], *args: Any
    ) -> T | None:
        """Return ``function(*args)`` after the calls before it; None if nobody wants it by then."""
        async with self._turn:
            if not wanted():
                return None
            self._began, self._owner = time.monotonic(), owner
            try:
                return await asyncio.to_thread(self._worker.call, None, function, *args)
            finally:
                self._began = 0.0

    async def warm_up(self) -> None:
        """Start the process before the first call needs it."""
        async with self._turn:
            await asyncio.to_thread(self._worker.start)

    def stop_if_running(self, owner: object) -> None:
        """End the running call, if it is one of `owner`; the next call has a new process."""
        if self._began and self._owner is owner:
            self.stop()

    def stop(self) -> None:
        """End the process and its call; the next call has a new process."""
        worker, self._worker = self._worker, Worker()
        worker.end()

    def close(self) -> None:
        """End the process for good."""
        self._worker.end()


@dataclass(eq=False)
class Session:
    """The explorer of one page; `send` takes a part of it to the browser, in the event loop."""

    start: Start
    send: Send
    judging: ExplorerJob  # the process of the verdict
    simulating: ExplorerJob  # the process of ngspice
    settings: Settings = field(default_factory=Settings)
    window: str = "rise"
    _number: int = 0  # of the newest values
    _look: SliderLook | None = None  # at the newest values
    _boundary: tuple[object, Edges | EngineError] | None = None  # and the values that it holds for
    _along: dict[str, tuple[Settings, dict[int, tuple[str, str]]]] = field(default_factory=dict)
    _simulates: bool = False
    _turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    async def move(self, wanted: Mapping[str, Any]) -> None:
        """Take new values from the page, and answer with what is fast."""
        try:
            self.settings = self._taken(wanted)
        except (InputError, ValueError) as error:
            wrong = list(wanted.get("texts", ())) if isinstance(wanted.get("texts"), dict) else []
            shown = settings_part(self.start, self.settings)
            self._tell(mistake=readable(str(error)), wrong=wrong, **shown)
            return
        self._number += 1
        number, settings = self._number, self.settings
        if self.judging.seconds(self) > PATIENCE:
            self.judging.stop()
        self.cancel()
        async with self._turn:
            shown, began = settings_part(self.start, settings), time.perf_counter()
            try:
                look, part = await asyncio.to_thread(look_at, self.start, settings, self.window)
            except TactionError as error:
                self._look = None
                self._tell(**shown, refused=readable(str(error)))
                return
            self._look, cost = look, time.perf_counter() - began
            shown |= along_part(self.start, self._known_along(settings))
            self._tell(**shown, **part, stamp=wanted.get("stamp"), cost=cost)
            if not look.rest.is_large:
                await self._step(partial(self._boundary_of, look), number)
        if number == self._number:
            self._begin(self._follow(look, number))

    def _taken(self, wanted: Mapping[str, Any]) -> Settings:
        """Return the settings that the page asks for; raises `InputError`."""
        move = read(Move, wanted)
        values, opamp = dict(self.settings.values), self.settings.opamp
        if move.reset:
            values, opamp = {}, ""
        for path, place in move.places.items():
            values[path] = self.start.control(path).chosen(place / STEPS)
        for path, text in move.texts.items():
            values[path] = read_value(self.start.control(path), text)
        settings = Settings.of(self.start, values, opamp if move.opamp is None else move.opamp)
        settings.scene(self.start)  # a value that its key does not accept changes nothing
        return settings

    def _tell(self, **part: Any) -> None:
        self.send({"number": self._number, **part})

    def _begin(self, work: Any) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)  # the loop alone would let it be collected
        task.add_done_callback(self._tasks.discard)

    async def _follow(self, look: SliderLook, number: int) -> None:
        """Find what is slower than a hand, in turn, once the hand rests and as long as it does."""
        await asyncio.sleep(REST)
        stages: tuple[Stage, ...] = (look.find_limits,)
        if look.rest.is_large:
            boundary = partial(self._boundary_of, look)
            stages = (partial(look.find_poles, self.window), look.find_limits, boundary)
        for stage in stages:
            if not await self._step(stage, number):
                return
        try:
            found = await self.judging.run(
                self, lambda: number == self._number, judge, look.scene, "statespace"
            )
        except WorkerDiedError as error:
            found = Judgement.without_verdict(error)
        if found is None or number != self._number:
            return
        look.verdict = found
        better = {} if look.is_exact else look.outputs_part(self.window)
        self._tell(**verdict_part(found), **better)
        if found.record.outcome != ERROR:
            await self._judge_along(look.settings, number)

    def _known_along(self, settings: Settings) -> dict[str, dict[int, tuple[str, str]]]:
        """Return what is known of the checks along each slider, and forget what holds no more."""
        for control in self.start.controls:
            key = others(control, settings)
            if self._along.get(control.path, (None, {}))[0] != key:
                self._along[control.path] = (key, {})
        return {path: outcomes for path, (_, outcomes) in self._along.items()}

    async def _judge_along(self, settings: Settings, number: int) -> None:
        """Find the outcome of the checks along each slider, as long as the hand rests."""
        known = self._known_along(settings)
        for control, cell, there in spots(self.start, settings):
            outcomes, began = known[control.path], time.monotonic()
            if cell in outcomes:
                continue
            try:
                scene = there.scene(self.start)
                found = await self.judging.run(
                    self, lambda: number == self._number, outcome_of, scene
                )
            except (InputError, WorkerDiedError) as error:
                found = ERROR, str(error).partition("\n")[0]
            if found is None or number != self._number:
                return
            outcomes[cell] = found
            self._tell(**along_part(self.start, known))
            if time.monotonic() - began > SLOW:  # 45 of them would take minutes
                return

    async def _step(self, stage: Stage, number: int) -> bool:
        """Tell what `stage` finds; return whether the values are still the newest."""
        if number != self._number:
            return False
        try:
            part = await asyncio.to_thread(stage)
        except TactionError as error:
            part = {"doubts": [readable(str(error))]}
        if number != self._number:
            return False
        self._tell(**part)
        return True

    def _boundary_of(self, look: SliderLook) -> Part:
        """Find the stable values of the first knob, which do not depend on its own value."""
        if look.poles is None:
            return {}
        control = self.start.controls[0]
        key = others(control, look.settings)
        if self._boundary is None or self._boundary[0] != key:
            name = look.rest.board.circuit.knob(control.path).name
            found: Edges | EngineError
            try:
                found = view_boundary(look.rest, look.poles, name, control.low, control.high)
            except EngineError as error:
                found = error
            self._boundary = (key, found)
        return boundary_part(self._boundary[1], control)

    def show(self, window: str) -> None:
        """Draw another window of time."""
        self.window = window if window in WINDOWS else self.window
        if self._look is not None:
            self._tell(**self._look.outputs_part(self.window))

    async def simulate(self) -> None:
        """Run ngspice on the present values."""
        look, number = self._look, self._number
        if look is None:  # no board with these values
            self._tell(simulating=False)
            return

        def current() -> bool:
            return self._simulates and number == self._number

        self._tell(simulating=True)
        self._simulates = True
        try:
            found = await self.simulating.run(self, current, judge, look.scene, "ngspice")
            found = found if current() else None
        except WorkerDiedError:
            found = None
        finally:
            self._simulates = False
        if found is None:
            self._tell(simulating=False)
            return
        look.other = found
        self._tell(simulating=False, **simulation_part(found), **look.outputs_part(self.window))

    def cancel(self) -> None:
        """End the run of ngspice of this page, if there is one."""
        if self._simulates:
            self._simulates = False  # also of a run that waits for that of another page
            self.simulating.stop_if_running(self)

    def save(self, name: str) -> None:
        """Write the present values to a new file."""
        try:
            file = self.settings.save(self.start, name.strip())
        except InputError as error:
            self._tell(saved="", save_mistake=readable(str(error)))
            return
        self._tell(saved=str(file), save_mistake="")
