"""A process beside the server for one slow call after the other, which can be ended."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, TypeVar

from taction.verification.studies.running.worker import Worker

T = TypeVar("T")


class Job:
    """Calls in one process; a call that is ended raises `WorkerDiedError`."""

    def __init__(self) -> None:
        self._worker, self._began = Worker(), 0.0
        self._turn = asyncio.Lock()

    @property
    def seconds(self) -> float:
        """For how long a call has been running, s; 0 if none is."""
        return time.monotonic() - self._began if self._began else 0.0

    async def run(
        self, wanted: Callable[[], bool], function: Callable[..., T], *args: Any
    ) -> T | None:
        """Return ``function(*args)`` after the calls before it; None if nobody wants it by then."""
        async with self._turn:
            if not wanted():
                return None
            self._began = time.monotonic()
            try:
                return await asyncio.to_thread(self._worker.call, None, function, *args)
            finally:
                self._began = 0.0

    async def warm_up(self) -> None:
        """Start the process before the first call needs it."""
        async with self._turn:
            await asyncio.to_thread(self._worker.start)

    def stop_if_running(self) -> None:
        """End the running call, if there is one; the next call has a new process."""
        if self._began:
            self.stop()

    def stop(self) -> None:
        """End the process and its call; the next call has a new process."""
        worker, self._worker = self._worker, Worker()
        worker.end()

    def close(self) -> None:
        """End the process for good."""
        self._worker.end()
