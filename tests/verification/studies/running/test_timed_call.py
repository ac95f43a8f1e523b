"""A process that computes and can be stopped."""

from __future__ import annotations

import math
import os
import time

import pytest

from spice_models.errors import EngineError
from verification.studies.running.timed_call import Worker


def test_it_answers_from_one_other_process_and_says_what_went_wrong() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        assert first != os.getpid()
        assert worker.call(30.0, math.hypot, 3.0, 4.0) == 5.0
        with pytest.raises(EngineError, match="math domain error"):
            worker.call(30.0, math.sqrt, -1.0)
        assert worker.call(30.0, os.getpid) == first


def test_a_late_or_dead_process_is_replaced() -> None:
    with Worker() as worker:
        first = worker.call(30.0, os.getpid)
        with pytest.raises(TimeoutError, match="not done after"):
            worker.call(0.05, time.sleep, 60.0)
        second = worker.call(30.0, os.getpid)
        assert second != first
        with pytest.raises(EngineError, match="died"):
            worker.call(30.0, os._exit, 1)
        assert worker.call(30.0, os.getpid) not in {first, second}
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)
