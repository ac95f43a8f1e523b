"""Workflow, hook and docs/ci.md say what the tool does."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from scripts import check
from taction.cli.main import COMMANDS, command, main
from taction.cli.running import made
from taction.netlist_gen.scene.checks import Regression
from taction.verification.studies.regression.run import Status
from tests.support.paths import ROOT

GUIDE = (ROOT / "docs" / "ci.md").read_text("utf-8")
WORKFLOW = yaml.safe_load((ROOT / ".github" / "workflows" / "taction.yml").read_text("utf-8"))
REGRESS = made("regress", command("regress"))
SHOWN = re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)


def accepts(command: str) -> dict[str, Any]:
    """Parse a command line as `taction regress` would, without running it."""
    words = shlex.split(command.partition("#")[0])
    assert words[:2] == ["taction", "regress"]
    # Without the group's settings click would keep a command without -h for the tests that follow.
    parent = click.Context(main, **main.context_settings)
    return REGRESS.make_context("regress", words[2:], parent=parent).params


def test_the_workflow_runs_what_anybody_can_run() -> None:
    steps = (step for job in WORKFLOW["jobs"].values() for step in job["steps"])
    lines = [step.get("run", "") for step in steps]
    assert ".ci/run" in lines
    (command,) = (line for line in lines if "bin/taction regress" in line)
    params = accepts(command.replace("/opt/taction/bin/", ""))
    assert (params["folder"], params["baseline"]) == ("scenes/", "scenes/baseline.json")
    assert WORKFLOW["permissions"] == {"contents": "read"}
    assert (params["junit"], params["markdown"]) == ("report.xml", "summary.md")


MAKE = """#!/bin/sh
echo "make $1" | tee -a "$SEEN"
[ "$1" != "$RED" ]
"""


Run = Callable[..., tuple[int, str, list[str]]]  # exit status, stdout, what `make` was asked for


@pytest.fixture
def ci(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """`.ci/run` with a `make` that only notes its target, and ends with 1 for `red`."""
    for name, text in {
        ".ci/run": (ROOT / ".ci" / "run").read_text("utf-8"),
        "scripts/bare.sh": 'make demo && make test; exit "$BARE"\n',
        "bin/make": MAKE,
        ".venv/bin/python": '#!/bin/sh\necho "$@"\n',
    }.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
        file.chmod(0o755)
    seen = tmp_path / "seen"
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("SEEN", str(seen))

    def run(*, red: str = "", bare: int = 0) -> tuple[int, str, list[str]]:
        seen.unlink(missing_ok=True)
        more = {**os.environ, "RED": red, "BARE": str(bare)}
        words = ["bash", str(tmp_path / ".ci" / "run")]
        done = subprocess.run(words, env=more, capture_output=True, text=True, timeout=60)
        assert done.stderr == ""
        return done.returncode, done.stdout, sorted(seen.read_text("utf-8").split("\n"))

    return run


def test_ci_runs_every_step_once_and_one_that_is_red_ends_it_red(ci: Run) -> None:
    status, text, made = ci()
    assert status == 0
    names = {line.removeprefix("make ") for line in made if line}
    assert len(made) == len(names) + 1
    others = {f"test-{name}" for name in ("simulators", "pythons", "kicad")}
    others |= {"test-browser", "test-install", "regress", "stress", "reproduce", "docs", "lint"}
    assert names == others | {"ready", "demo", "test"}
    makefile = (ROOT / "Makefile").read_text("utf-8")
    assert "taction regress scenes/ --baseline scenes/baseline.json" in makefile
    targets = set(re.findall(r"^([a-z-]+):.*## |^(ready):", makefile, re.MULTILINE))
    targets = {name for pair in targets for name in pair}
    assert names <= targets
    (steps,) = re.findall(r"^NIGHTLY := (.*)$", makefile, re.MULTILINE)
    rules = re.findall(r"^(nightly-[a-z -]+): (.*)$", makefile, re.MULTILINE)
    assert {f"nightly-{s}" for s in steps.split()} == {n for rule, _ in rules for n in rule.split()}
    assert set(re.findall(r"MAKE\) ([a-z-]+)", " ".join(text for _, text in rules))) <= targets
    assert all(f"== make {name}: " in text for name in others)
    for red in ("ready", "docs", "regress"):
        status, _, again = ci(red=red)
        assert (status, again) == (1, made)
    assert ci(bare=1)[0] == 1
    status, text, made = ci(bare=3)  # no bare system: tests outside of one, and red
    assert (status, made.count("make test")) == (1, 2)
    assert "no bare system" in text


def test_a_check_before_a_commit_runs_the_tests_of_what_changed() -> None:
    found = check.tests_of(["taction/verification/verdict/verify.py", "tests/cli/test_files.py"])
    names = [file.relative_to(ROOT / "tests").as_posix() for file in found]
    assert names[0] == "cli/test_files.py"
    assert names[1].startswith("verification/verdict/test_verify")
    assert "verification/studies/test_sweep.py" not in names[:3]
    # No test imports this module: the command loads it when it runs.
    commands = {file.parent for file in check.tests_of(["taction/cli/verify_scene.py"])}
    assert commands == {ROOT / "tests" / "cli"}
    screen = "taction/verification/report/views/verdict_screen.py"
    views = [file.name for file in check.tests_of([screen])]
    assert views[0] == "test_verdict_screen.py"


def test_the_hook_is_one_that_pre_commit_can_read() -> None:
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text("utf-8"))
    assert {"id", "name", "entry", "language"} <= hook.keys()
    assert hook["language"] == "python"
    assert hook["entry"].split()[1] in COMMANDS
    accepts(shlex.join([*hook["entry"].split(), *hook["args"]]))
    pattern = re.compile(hook["files"])
    changed = ["scenes/a.toml", "scenes/a/T.csv", "scenes/baseline.json"]
    assert all(pattern.search(name) for name in changed)
    assert not pattern.search("cli/scenes.py")
    assert f"id: {hook['id']}" in GUIDE


def test_the_guide_explains_every_option_and_every_status() -> None:
    for option in (param.opts[0] for param in REGRESS.params if param.opts[0].startswith("--")):
        assert option in GUIDE
    rows = re.findall(r"^\| ([a-z ]+) \| .* \| ([0-9 or]+) \|$", GUIDE, re.MULTILINE)
    assert {name for name, _ in rows} == {s.value for s in Status} - {Status.NOT_RUN.value}


def test_the_tolerances_shown_are_the_defaults() -> None:
    for text in (*SHOWN, (ROOT / "taction" / "scene_template.toml").read_text("utf-8")):
        groups = tomllib.loads(text)["regression"]
        assert Regression.model_validate(groups) == Regression()
        assert groups.keys() == Regression.model_fields.keys()
