"""A step after a result costs that step alone."""

from __future__ import annotations

import pytest

from taction.system import progress as after_result
from taction.system.progress import LONGEST, attempt


def test_a_step_that_fails_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))
    told: list[str] = []

    def step() -> int:
        raise ValueError("two\nlines " + "x" * 10_000)

    assert attempt("the step", step, 3, told.append) == 3
    assert told[0].startswith(r"the step failed, the result stands: ValueError: two\nlines x")
    assert len(told[0]) < LONGEST + 60
    assert attempt("the step", lambda: 4, 3, told.append) == 4
    assert len(told) == 1


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(2), BrokenPipeError()])
def test_what_is_no_failure_of_the_step_passes(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))

    def step() -> None:
        raise error

    with pytest.raises(type(error)):
        attempt("the step", step, None, print, lambda each: isinstance(each, OSError))
