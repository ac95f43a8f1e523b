"""A process that computes and can be stopped."""

from __future__ import annotations

import math
import os
import time

import pytest

from taction.verification.studies.running.worker import Worker, WorkerDiedError


def test_it_answers_from_one_other_process_and_says_what_went_wrong() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        assert first != os.getpid()
        assert worker.call(30.0, math.hypot, 3.0, 4.0) == 5.0
        with pytest.raises(ValueError, match="math domain error"):
            worker.call(30.0, math.sqrt, -1.0)
        assert worker.call(30.0, os.getpid) == first


def test_an_answer_that_cannot_be_sent_is_an_error_and_not_the_end() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        with pytest.raises(TypeError, match="cannot be sent"):
            worker.call(30.0, memoryview, b"x")
        with pytest.raises(FileNotFoundError):  # of the call, not of the pipe
            worker.call(30.0, os.stat, "/no/such/file")
        assert worker.call(30.0, os.getpid) == first


def test_a_late_or_dead_process_is_replaced() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        with pytest.raises(TimeoutError, match="not done after"):
            worker.call(0.05, time.sleep, 60.0)
        second = worker.call(30.0, os.getpid)
        assert second != first
        with pytest.raises(WorkerDiedError, match="died"):
            worker.call(30.0, os._exit, 1)
        assert worker.call(30.0, os.getpid) not in {first, second}
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)
