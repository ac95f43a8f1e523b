"""Every example in a docstring gives what it says; those of the door are in `tests/taction/`."""

from __future__ import annotations

import doctest
import importlib

import pytest

from scripts.rooms import modules
from taction.system import after_result
from tests.support.paths import ROOT

WITH_EXAMPLES = [
    name
    for name, path in modules().items()
    if not name.startswith("door") and ">>> " in path.read_text("utf-8")
]


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_the_examples_of_a_module(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))  # as users have it
    result = doctest.testmod(importlib.import_module(f"taction.{name}"))
    assert result.attempted
    assert not result.failed
