"""Workflow, hook and docs/ci.md say what the tool does."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import click
import yaml

from taction.cli.main import command, main
from taction.cli.running import made
from taction.netlist_gen.scene.check_keys import Regression
from taction.verification.studies.regression.regress import Status
from tests.support.paths import ROOT

GUIDE = (ROOT / "docs" / "ci.md").read_text("utf-8")
REGRESS = made("regress", command("regress"))


def accepts(command: str) -> dict[str, Any]:
    """Parse a command line as `taction regress` would, without running it."""
    words = shlex.split(command.partition("#")[0])
    assert words[:2] == ["taction", "regress"]
    # Without the group's settings click would keep a command without -h for the tests that follow.
    parent = click.Context(main, **main.context_settings)
    return REGRESS.make_context("regress", words[2:], parent=parent).params


def test_the_workflow_runs_what_anybody_can_run() -> None:
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "taction.yml").read_text("utf-8"))
    steps = (step for job in workflow["jobs"].values() for step in job["steps"])
    lines = [step.get("run", "") for step in steps]
    assert ".ci/run" in lines
    (command,) = (line for line in lines if "bin/taction regress" in line)
    params = accepts(command.replace("/opt/taction/bin/", ""))
    assert (params["folder"], params["baseline"]) == ("scenes/", "scenes/baseline.json")
    assert (params["junit"], params["markdown"]) == ("report.xml", "summary.md")


def test_one_red_step_of_ci_ends_it_red_and_stops_no_other(tmp_path: Path) -> None:
    """`.ci/run` with a `make` that only notes its target, and ends with 1 for `$RED`."""
    for name, text in {
        ".ci/run": (ROOT / ".ci" / "run").read_text("utf-8"),
        "scripts/bare.sh": 'make demo && make test; exit "$BARE"\n',
        "bin/make": '#!/bin/sh\necho "make $1" >> "$SEEN"\n[ "$1" != "$RED" ]\n',
    }.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
        file.chmod(0o755)
    path, seen = f"{tmp_path / 'bin'}:{os.environ['PATH']}", tmp_path / "seen"

    def run(red: str, bare: int = 0) -> tuple[int, list[str]]:
        seen.unlink(missing_ok=True)
        more = {"PATH": path, "SEEN": str(seen), "RED": red, "BARE": str(bare)}
        words = ["bash", str(tmp_path / ".ci" / "run")]
        done = subprocess.run(words, env=os.environ | more, capture_output=True, timeout=60)
        return done.returncode, sorted(seen.read_text("utf-8").split("\n"))

    status, made = run("")
    assert (status, len(made)) == (0, len(set(made)))
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert {line.removeprefix("make ") for line in made if line} <= set(targets)
    for red in ("ready", "docs"):
        assert run(red) == (1, made)
    status, made = run("", bare=3)  # no bare system: tests outside of one, and red
    assert (status, made.count("make test")) == (1, 2)


def test_the_hook_is_one_that_pre_commit_can_read() -> None:
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text("utf-8"))
    assert {"id", "name", "language"} <= hook.keys()
    accepts(shlex.join([*hook["entry"].split(), *hook["args"]]))
    pattern = re.compile(hook["files"])
    changed = ["scenes/a.toml", "scenes/a/T.csv", "scenes/baseline.json"]
    assert all(pattern.search(name) for name in changed)
    assert not pattern.search("cli/scenes.py")
    assert f"id: {hook['id']}" in GUIDE


def test_the_guide_explains_every_option_every_status_and_the_tolerances() -> None:
    for option in (param.opts[0] for param in REGRESS.params if param.opts[0].startswith("--")):
        assert option in GUIDE
    rows = re.findall(r"^\| ([a-z ]+) \| .* \| ([0-9 or]+) \|$", GUIDE, re.MULTILINE)
    assert {name for name, _ in rows} == {s.value for s in Status} - {Status.NOT_RUN.value}
    shown = re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)
    for text in (*shown, (ROOT / "taction" / "scene_template.toml").read_text("utf-8")):
        groups = tomllib.loads(text)["regression"]
        assert Regression.model_validate(groups) == Regression()
        assert groups.keys() == Regression.model_fields.keys()
