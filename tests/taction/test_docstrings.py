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

JOBS = ("netlist", "solve", "simulate", "verify", "onset", "sweep", "montecarlo")
# What several jobs take, in the order in which each of them takes it.
SHARED = ("scene", "over", "engine", "strains", "output", "jobs", "cluster", "progress")
SECTIONS = ["Parameters", "Returns", "Raises", "Examples"]
FUNCTIONS = (*JOBS, "load_scene", "synthesise", "write_deck", "Scene.from_arrays")


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
    return dict(re.findall(r"^(\w+) : (.+)$", sections(public(name))["Parameters"], re.MULTILINE))


@pytest.mark.parametrize("name", JOBS)
def test_a_job_takes_the_scene_first_and_the_rest_by_keyword(name: str) -> None:
    first, *rest = parameters(name).values()
    assert (first.name, first.kind) == ("scene", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    assert {each.kind for each in rest} == {inspect.Parameter.KEYWORD_ONLY}
    shared = [each for each in parameters(name) if each in SHARED]
    assert shared == sorted(shared, key=SHARED.index)


@pytest.mark.parametrize("keyword", SHARED)
def test_a_keyword_means_the_same_in_every_job(keyword: str) -> None:
    taking = [name for name in JOBS if keyword in parameters(name)]
    assert len(taking) > 1
    assert len({str(parameters(name)[keyword].annotation) for name in taking}) == 1
    assert len({documented(name)[keyword] for name in taking}) == 1


@pytest.mark.parametrize("name", JOBS)
def test_a_job_documents_its_parameters_and_has_every_section(name: str) -> None:
    assert list(sections(public(name))) == SECTIONS
    assert list(documented(name)) == list(parameters(name))


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
