"""A Python process that computes for a study and can be stopped when its time is up.

An integrator inside this process could not be: its time-out would be a gap in the study.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from types import TracebackType
from typing import ParamSpec, TypeVar

import numpy as np

from spice_models.errors import EngineError, NoVerdictError

P = ParamSpec("P")
T = TypeVar("T")

START_UP = 60.0  # s; a busy machine may take long to start Python and load SciPy
EXPECTED = (NoVerdictError, ArithmeticError, MemoryError, ValueError, np.linalg.LinAlgError)


class Worker:
    """One process, started by the first call and again after a call that it did not survive."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def call(self, timeout: float, function: Callable[P, T], *args: P.args, **kw: P.kwargs) -> T:
        """Return ``function(*args, **kw)``, computed in the process.

        Parameters
        ----------
        timeout : float
            s; the start of the process does not count.
        function : callable
            Of a module's top level; arguments and result can be pickled.

        Raises
        ------
        TimeoutError
            It took longer; the process was ended.
        EngineError
            The function raised one of `EXPECTED`, or the process died.
        """
        pipe = self._pipe or self._start()
        try:
            pipe.send((function, args, kw))
            if not pipe.poll(max(timeout, 0.0)):
                self.stop()
                message = f"not done after {timeout:.3g} s"
                raise TimeoutError(message)
            done, result = pipe.recv()
        except (EOFError, BrokenPipeError, ConnectionResetError):
            self.stop()
            message = f"the process that ran {function.__name__} died"
            raise EngineError(message) from None
        if not done:
            raise EngineError(result)
        found: T = result
        return found

    def stop(self) -> None:
        """End the process."""
        if self._process is not None and self._pipe is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()
            self._process.close()
        self._process = self._pipe = None

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        self._process, self._pipe = process, ours
        if not ours.poll(START_UP):
            self.stop()
            raise EngineError(f"no second Python process within {START_UP:g} s")
        ours.recv()
        return ours


def _serve(pipe: Connection) -> None:
    """Answer calls until the other end closes."""
    import scipy.integrate  # noqa: F401  loaded now, so that no measurement holds it

    pipe.send("ready")
    while True:
        try:
            function, args, kw = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            answer = (True, function(*args, **kw))
        except EXPECTED as error:
            answer = (False, f"{type(error).__name__}: {error}")
        pipe.send(answer)
