"""docs/promises.md names tests and numbers that exist."""

from __future__ import annotations

import ast
import importlib
import re

import pytest

from tests.support.paths import ROOT

PAGE = (ROOT / "docs" / "promises.md").read_text("utf-8")
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)))
LIMITS = re.findall(r"\| (\S+) \|[^|]*\| `([\w.]+)\.([A-Z_]+)` \|", PAGE)
PROMISES = re.findall(r"^(\d+)\. (.*?)(?=^\d+\. |^## )", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(("file", "name"), TESTS)
def test_every_test_that_the_page_names_exists(file: str, name: str) -> None:
    tree = ast.parse((ROOT / file).read_text("utf-8"))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_promise_has_a_test() -> None:
    assert [int(number) for number, _ in PROMISES] == list(range(1, len(PROMISES) + 1))
    assert len(PROMISES) > 10
    for number, text in PROMISES:
        assert re.search(r"`tests/[\w/]+\.py::\w+`", text), f"promise {number} has no test"


@pytest.mark.parametrize(("number", "module", "name"), LIMITS)
def test_every_limit_is_the_number_of_the_code(number: str, module: str, name: str) -> None:
    assert float(number) == getattr(importlib.import_module(module), name)


def test_the_page_has_limits() -> None:
    assert len(LIMITS) == PAGE.split("## Limits")[1].split("## Fuzzing")[0].count("\n| ") - 1
