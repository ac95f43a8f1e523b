"""The public names: light, lazy, typed, called in one way; and the pytest plugin."""

from __future__ import annotations

import doctest
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

import taction
from tests.support import nightly
from tests.support.entries import write_fast
from tests.support.paths import ROOT, SCENES
from tests.support.running import python
from tests.support.running import taction as command

HEAVY = ("numpy", "scipy", "pydantic", "click", "rich", "PySpice")


def loaded_by(script: str) -> set[str]:
    """Run a script in a fresh Python and return the modules that it has loaded."""
    run = python("-c", f"{script}\nimport sys; print(); print(*sys.modules)")
    assert run.returncode == 0, run.stderr
    return set(run.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("use", ["dir(taction)", "taction.netlist, taction.verify"])
def test_import_taction_and_its_jobs_load_nothing_heavy(use: str) -> None:
    assert not loaded_by(f"import taction; {use}") & set(HEAVY)


def test_every_public_name_is_listed_and_found() -> None:
    assert set(taction.__all__) <= set(dir(taction))
    assert sorted(taction.__all__) == taction.__all__
    assert all(getattr(taction, name) is not None for name in taction.__all__)


def without_times(text: str) -> list[str]:
    """The screen up to the line that states how long everything took."""
    *lines, last, _ = text.splitlines()
    assert "; more: -v" in last
    return lines


@pytest.mark.parametrize("name", ["paper-breadboard", "custom-matrix"])
def test_print_shows_the_screen_of_the_command(name: str) -> None:
    file = SCENES / f"{name}.toml"
    shown = command("verify", str(file), "--engine", "statespace")
    verdict = taction.verify(file, engine="statespace")
    assert without_times(str(verdict)) == without_times(shown.stdout)
    assert str(verdict).splitlines()[-1] == verdict.outcome.value.upper() == "PASS"


def test_a_table_has_one_row_a_point(tmp_path: Path) -> None:
    over = {"C": ("10pF", "20pF", 2), "topology": ["integrator", "passive"]}
    result = taction.sweep(write_fast(tmp_path / "a.toml"), over=over, jobs=1)
    table = result.to_pandas()
    assert table["C"].tolist() == [1e-11, 1e-11, 2e-11, 2e-11]
    assert table["topology"].tolist() == ["integrator", "passive"] * 2
    assert table["settling_time"].tolist() == [r["settling_time"] for r in result.records()]


def test_arrays_are_swept_in_other_processes() -> None:
    parts = {"capacitance": "1nF", "gain": "100kohm", "unit_conductance": "10uS", "opamp": "opa189"}
    made = taction.Scene.from_arrays([[1.0, 0.5], [0.5, 1.0]], [0.2, 0.1], lam=0.1, **parts)
    result = taction.sweep(made, over={"C": ["1nF", "2nF"]}, engine="statespace", jobs=2)
    assert result.to_pandas()["outcome"].tolist() == ["pass", "pass"]


STEPS = ("load_scene", "synthesise", "write_deck")
DOCUMENTED_JOBS = tuple(name for name in taction.__all__ if name.islower() and name not in STEPS)
LONG = ("explore", "mcp", "reproduce")  # one ends with Ctrl-C, one takes minutes
FUNCTIONS = tuple(
    name for name in (*DOCUMENTED_JOBS, *STEPS, "Scene.from_arrays") if name not in LONG
)
# What several jobs take, in the order in which each of them takes it.
SHARED = ("scene", "over", "engine", "strains", "output", "jobs", "cluster", "progress")
SECTIONS = ["Parameters", "Returns", "Raises", "Examples"]


def public(name: str) -> Any:
    return resolve_name(f"taction:{name}")


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


@pytest.mark.parametrize("name", DOCUMENTED_JOBS)
def test_a_job_takes_the_scene_first_and_the_rest_by_keyword(name: str) -> None:
    given = parameters(name)
    if "scene" in given:
        assert next(iter(given)) == "scene"
    positional = [n for n, each in given.items() if each.kind is not each.KEYWORD_ONLY]
    assert positional in ([*given][:1], ["first", "second"], [])
    shared = [each for each in given if each in SHARED]
    assert shared == sorted(shared, key=SHARED.index)


@pytest.mark.parametrize("name", DOCUMENTED_JOBS)
def test_a_job_documents_its_parameters_and_has_its_sections(name: str) -> None:
    found = list(sections(public(name)))
    assert found == [each for each in SECTIONS if each in found]
    assert found[-1] == "Examples"
    assert ("Parameters" in found) is bool(parameters(name))
    assert ("Returns" in found) is (name not in ("explore", "mcp"))
    assert list(documented(name)) == list(parameters(name))


SLOW = ("onset", "scale", "tune")  # `docs/tour.md` has them with every commit


@pytest.mark.usefixtures("quick_stories")
@pytest.mark.parametrize("name", ["", *sorted({*FUNCTIONS} - {*SLOW}), *nightly(*SLOW)])
def test_the_examples_run(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    examples = doctest.DocTestFinder(recurse=False).find(public(name), name, globs={})
    results = [doctest.DocTestRunner().run(example) for example in examples]
    assert sum(result.attempted for result in results) > 1
    assert sum(result.failed for result in results) == 0


pytest_plugins = ["pytester"]

NOT_LOADED = ("numpy", "scipy", "pydantic", "PySpice", "rich", "netlist_gen", "verification")
LEFT_OUT = ("anyio", "cacheprovider", "hypothesispytest", "xdist")


@pytest.fixture
def session(pytester: pytest.Pytester) -> Iterator[pytest.Pytester]:
    """A folder with a pytest session that has our plugin, and of others none, and no cache.

    At its end pytest forgets the modules that this process has imported meanwhile. Of ours, a test
    that needs one later would import a second copy, whose classes are not those of the first.
    """
    pytester.makeini(f"[pytest]\naddopts = {' '.join(f'-p no:{name}' for name in LEFT_OUT)}\n")
    before = set(sys.modules)
    yield pytester
    assert not [name for name in set(sys.modules) - before if name.startswith("taction")]


def run(session: pytest.Pytester, *words: str) -> pytest.RunResult:
    return session.runpytest_subprocess(*words, timeout=120)


def test_a_session_without_scenes_loads_nothing_of_taction(session: pytest.Pytester) -> None:
    session.makepyfile(
        f"""
        import sys

        def test_light():
            assert "taction.pytest_plugin" in sys.modules
            assert not set(sys.modules) & set({NOT_LOADED!r})
        """
    )
    run(session).assert_outcomes(passed=1)


def test_scene_files_are_judged_and_the_fixture_verifies_a_scene_once(
    session: pytest.Pytester,
) -> None:
    write_fast(session.path / "good.scene.toml")
    write_fast(session.path / "slow.scene.toml", limit="1us")
    write_fast(session.path / "not-ours.toml", limit="1us")
    (session.path / "odd.scene.toml").write_text("[problem]\nkind = 'tactil'\n")
    write_fast(session.mkdir("boards") / "a.toml")
    session.makepyfile(
        """
        seen = []

        def test_board(taction_scene):
            verdict = taction_scene("boards/a.toml")
            assert verdict.outcome.value == "pass"
            assert verdict.measurements.settling_time.value < 1e-3
            seen.append(verdict)

        def test_the_same_board(taction_scene):
            assert taction_scene("boards/a.toml") is seen[0]
            assert taction_scene("boards/a.toml", engine="statespace") is not seen[0]

        def test_no_board(taction_scene):
            taction_scene("none.toml")
        """
    )
    result = run(session)
    result.assert_outcomes(passed=3, failed=3)
    result.stdout.fnmatch_lines_random(
        [
            "odd.scene.toml: bad input",
            "*problem.kind = 'tactil': did you mean 'tactile'*",
            "slow.scene.toml: fail",
            "*settles to ±1 % in *(limit: at most *)*",
            "*InputError*none.toml*No such file*",
        ]
    )
    result.stdout.no_fnmatch_line("*Traceback*")


def test_collected_scenes_are_compared_with_a_baseline(session: pytest.Pytester) -> None:
    scene = write_fast(session.path / "a.scene.toml")
    words = ["regress", str(session.path), "--baseline", str(session.path / "b.json"), "--update"]
    assert python("-m", "taction", *words).returncode == 0
    option = "--taction-baseline=b.json"
    run(session, option).assert_outcomes(passed=1)
    write_fast(scene, capacitance="10.5pF")
    run(session).assert_outcomes(passed=1)
    result = run(session, option)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*a.scene.toml: changed*", "*tolerances off*"])
