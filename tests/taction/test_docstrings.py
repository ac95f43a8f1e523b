"""One calling convention for all jobs, and every example in their documentation runs."""

from __future__ import annotations

import doctest
import inspect
import re
from collections.abc import Callable
from typing import Any

import pytest

import taction
from tests.support.paths import ROOT

STEPS = ("load_scene", "synthesise", "write_deck")
JOBS = tuple(name for name in taction.__all__ if name.islower() and name not in STEPS)
LONG = ("explore", "mcp", "reproduce")  # one ends with Ctrl-C, one takes minutes
FUNCTIONS = tuple(name for name in (*JOBS, *STEPS, "Scene.from_arrays") if name not in LONG)
# What several jobs take, in the order in which each of them takes it.
SHARED = ("scene", "over", "engine", "strains", "output", "jobs", "cluster", "progress")
SECTIONS = ["Parameters", "Returns", "Raises", "Examples"]


def public(name: str) -> Any:
    found: Any = taction
    for part in name.split("."):
        found = getattr(found, part)
    return found


def parameters(name: str) -> dict[str, inspect.Parameter]:
    return dict(inspect.signature(public(name)).parameters)


def sections(function: Callable[..., Any]) -> dict[str, str]:
    """The sections of a numpydoc docstring by title."""
    parts = re.split(r"^(\w+)\n-+\n", inspect.getdoc(function) or "", flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(name: str) -> dict[str, str]:
    """The documented parameters and what is said of their type."""
    listed = sections(public(name)).get("Parameters", "")
    lines = re.findall(r"^(\w+(?:, \w+)*) : (.+)$", listed, re.MULTILINE)
    return {each: kind for names, kind in lines for each in names.split(", ")}


@pytest.mark.parametrize("name", JOBS)
def test_a_job_takes_the_scene_first_and_the_rest_by_keyword(name: str) -> None:
    given = parameters(name)
    if "scene" in given:
        assert next(iter(given)) == "scene"
    positional = [n for n, each in given.items() if each.kind is not each.KEYWORD_ONLY]
    assert positional in ([*given][:1], ["first", "second"], [])
    shared = [each for each in given if each in SHARED]
    assert shared == sorted(shared, key=SHARED.index)


@pytest.mark.parametrize("name", JOBS)
def test_a_job_documents_its_parameters_and_has_its_sections(name: str) -> None:
    found = list(sections(public(name)))
    assert found == [each for each in SECTIONS if each in found]
    assert found[-1] == "Examples"
    assert ("Parameters" in found) is bool(parameters(name))
    assert ("Returns" in found) is (name not in ("explore", "mcp"))
    assert list(documented(name)) == list(parameters(name))


@pytest.mark.usefixtures("quick_stories")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_examples_run(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    examples = doctest.DocTestFinder(recurse=False).find(public(name), name, globs={})
    results = [doctest.DocTestRunner().run(example) for example in examples]
    assert sum(result.attempted for result in results) > 1
    assert sum(result.failed for result in results) == 0


def test_the_example_of_the_package_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(taction)
    assert result.attempted > 1
    assert result.failed == 0
