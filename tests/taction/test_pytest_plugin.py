"""The pytest plugin, in pytest sessions of its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from tests.support.entries import write_fast
from tests.support.running import python

pytest_plugins = ["pytester"]

HEAVY = ("numpy", "scipy", "pydantic", "PySpice", "rich", "netlist_gen", "verification")
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
            assert not set(sys.modules) & set({HEAVY!r})
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
