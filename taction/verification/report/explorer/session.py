"""One open page: the values under the hand, and what the page is told, what is fast first.

The page sends values and waits for their curves before it sends more, so nothing queues up. What is
slow runs in processes of its own; new values cancel what is still to be found for earlier ones.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

from taction.netlist_gen.scene.keys import scene_text
from taction.system.documents import read
from taction.system.errors import EngineError, InputError, TactionError
from taction.system.quantities import readable
from taction.verification.design import exploration
from taction.verification.design.exploration import STEPS, Judgement, Settings
from taction.verification.report.explorer import page_parts as parts
from taction.verification.report.explorer.page_parts import Part, SliderLook
from taction.verification.stability.edges import Edges
from taction.verification.studies.running.study import Worker, WorkerDiedError
from taction.verification.verdict.record import ERROR, Record

T = TypeVar("T")
REST = 0.12  # s without new values, after which the hand rests
WINDOWS = ("rise", "whole")
SLOW = 2.0  # s of a verdict, above which the other places of the sliders show no checks
PATIENCE = 3.0  # s that a call which nobody waits for may still take


@dataclass(frozen=True, slots=True)
class Move:
    """What a page asks for: places of sliders from 0 to `STEPS`, typed texts, an op-amp."""

    places: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    opamp: str | None = None
    reset: bool = False


class ExplorerJob:
    """Calls in one process, one after the other; a call whose process ends: `WorkerDiedError`."""

    def __init__(self) -> None:
        self._worker = Worker()
        self._call: asyncio.Task[Any] | None = None
        self._turn = asyncio.Lock()

    async def run(self, function: Callable[..., T], *args: Any) -> T:
        """Return ``function(*args)``; where this is cancelled, the call goes on for a while."""
        async with self._turn:
            if self._call is not None:
                await asyncio.wait([self._call], timeout=PATIENCE)
                if not self._call.done():
                    self.stop()
            call = asyncio.create_task(asyncio.to_thread(self._worker.call, None, function, *args))
            call.add_done_callback(lambda done: done.cancelled() or done.exception())
            self._call = call
            return await asyncio.shield(call)

    async def warm_up(self) -> None:
        """Start the process before the first call needs it."""
        async with self._turn:
            await asyncio.to_thread(self._worker.start)

    def stop(self) -> None:
        """End the process and its call; the next call has a new process."""
        worker, self._worker = self._worker, Worker()
        worker.end()


@dataclass(eq=False)
class Session:
    """The explorer of one page; `send` takes a part of it to the browser, in the event loop."""

    settings: Settings
    send: Callable[[Part], None]
    judging: ExplorerJob  # the process of the verdict
    window: str = "rise"
    work: asyncio.Task[None] | None = None  # what is found for the newest values
    strips: asyncio.Task[None] | None = None  # what is found of the checks along the sliders
    _number: int = 0  # of the newest values
    _outcomes: dict[str, tuple[str, str]] = field(default_factory=dict)  # along the sliders
    _look: SliderLook | None = None  # at the newest values
    _boundary: tuple[object, Edges | EngineError] | None = None  # and the values that it holds for

    def move(self, wanted: Mapping[str, Any]) -> None:
        """Take new values from the page, and begin to answer."""
        try:
            self.settings = self._taken(wanted)
        except (InputError, ValueError) as error:
            typed = wanted.get("texts") if isinstance(wanted, Mapping) else None
            wrong = list(typed) if isinstance(typed, dict) else []
            shown = parts.settings_part(self.settings)
            self._tell(mistake=readable(str(error)), wrong=wrong, **shown)
            return
        self._number += 1
        self.close()
        self.work = asyncio.create_task(self._follow(self.settings))

    def _taken(self, wanted: Mapping[str, Any]) -> Settings:
        """Return the settings that the page asks for; raises `InputError`."""
        move = read(Move, wanted)
        values, opamp = dict(self.settings.values), self.settings.opamp
        if move.reset:
            values, opamp = {}, ""
        for path, place in move.places.items():
            values[path] = self.settings.control(path).chosen(place / STEPS)
        for path, text in move.texts.items():
            values[path] = self.settings.typed(path, text)
        settings = self.settings.moved(values, opamp if move.opamp is None else move.opamp)
        settings.scene()  # a value that its key does not accept changes nothing
        return settings

    def _tell(self, **part: Any) -> None:
        self.send({"number": self._number, **part})

    async def _follow(self, settings: Settings) -> None:
        """Answer with what is fast, then find what is slower than a hand, once the hand rests."""
        shown = parts.settings_part(settings)
        try:
            look, part = await asyncio.to_thread(parts.look_at, settings, self.window)
        except TactionError as error:
            self._look = None
            self._tell(**shown, refused=readable(str(error)))
            return
        self._look = look
        self._tell(**shown, **part)
        boundary, poles = partial(self._boundary_of, look), partial(look.find_poles, self.window)
        large = look.view.board.descriptor.is_large
        if not large:
            await self._step(boundary)
        await asyncio.sleep(REST)
        for stage in (poles, look.find_limits, boundary) if large else (look.find_limits,):
            await self._step(stage)
        await self._judge(look, "statespace")
        self.strips = asyncio.create_task(self._judge_along(settings))

    async def _judge_along(self, settings: Settings) -> None:
        """Tell the outcomes of the checks along each slider, the nearest places first."""
        every = await asyncio.to_thread(parts.spots, settings)
        self._tell(**parts.along_part(every, self._outcomes))
        for spot in sorted(every, key=lambda each: each.far):
            if spot.key in self._outcomes:
                continue
            began = time.monotonic()
            try:
                found = await self.judging.run(exploration.outcome_of, spot.settings.scene())
            except (InputError, WorkerDiedError) as error:
                found = ERROR, str(error).partition("\n")[0]
            self._outcomes[spot.key] = found
            self._tell(**parts.along_part(every, self._outcomes))
            if time.monotonic() - began > SLOW:
                return

    def simulate(self) -> None:
        """Judge the present values by ngspice, too, once their verdict is known."""
        if self._look is not None and self.work is not None and self.work.done():
            self.work = asyncio.create_task(self._judge(self._look, "ngspice"))

    async def _judge(self, look: SliderLook, engine: str) -> None:
        """Tell the verdict by an engine."""
        try:
            look.verdict = await self.judging.run(exploration.judge, look.view.scene, engine)
        except WorkerDiedError as error:
            look.verdict = Judgement(Record.without_verdict(error, ""))
        better = {} if look.is_exact else look.outputs_part(self.window)
        self._tell(**parts.verdict_part(look.verdict), **better)

    async def _step(self, stage: Callable[[], Part]) -> None:
        """Tell what `stage` finds."""
        try:
            self._tell(**await asyncio.to_thread(stage))
        except TactionError as error:
            self._tell(doubts=[readable(str(error))])

    def _boundary_of(self, look: SliderLook) -> Part:
        """Find the stable values of the first knob, which do not depend on its own value."""
        control, values = self.settings.controls[0], dict(look.settings.values)
        values.pop(control.path, None)
        key = replace(look.settings, values=values)
        if self._boundary is None or self._boundary[0] != key:
            name = look.view.board.circuit.knob(control.path).name
            found: Edges | EngineError
            try:
                found = look.view.boundary(name, control.low, control.high)
            except EngineError as error:
                found = error
            self._boundary = (key, found)
        return parts.boundary_part(self._boundary[1], control)

    def show(self, window: str) -> None:
        """Draw another window of time."""
        self.window = window if window in WINDOWS else self.window
        if self._look is not None:
            self._tell(**self._look.outputs_part(self.window))

    def save(self) -> None:
        """Send the present values as the text of a scene file, for the folder of the scene's."""
        self._tell(scene=scene_text(self.settings.scene()))

    def close(self) -> None:
        """End what is still to be found."""
        for task in filter(None, (self.work, self.strips)):
            task.cancel()
