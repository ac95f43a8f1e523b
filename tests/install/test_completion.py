"""Completion in bash, zsh and fish: what the shell has loaded, and what it offers for a word."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.install.conftest import Environment, outside

# How each starts without the user's files, loads the completion, and tells what `$1` becomes.
SHELLS = {
    "bash": (
        ("--norc", "--noprofile", "-c"),
        'eval "$(_TACTION_COMPLETE=bash_source taction)"; complete -p taction >&2; '
        "COMP_WORDS=($1); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _taction_completion taction; "
        'echo "${COMPREPLY[@]}"; compopt() { echo files; }; _taction_completion taction',
    ),
    "zsh": (
        ("-f", "-c"),
        "autoload -U compinit && compinit -u -d dump; "
        'eval "$(_TACTION_COMPLETE=zsh_source taction)"; echo $_comps[taction] >&2; '
        'words=(${=1}); CURRENT=${#words}; compadd() { echo "$@" }; _describe() { print ${(P)3} }; '
        "_path_files() { echo files }; _taction_completion",
    ),
    "fish": (
        ("--no-config", "-c"),
        "_TACTION_COMPLETE=fish_source taction | source; complete -C $argv[1]",
    ),
}


@pytest.mark.parametrize(
    ("line", "whole"), [("taction ver", "verify"), ("taction verify my-b", "my-board.toml|files")]
)
@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_completes_a_word(
    shell: str, line: str, whole: str, by_uv: Environment, tmp_path: Path
) -> None:
    words, script = SHELLS[shell]
    path = shutil.which(shell)
    if path is None:
        reason = f"{shell} is not here; `make test-install` installs it where it may"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)
    (tmp_path / "my-board.toml").touch()
    search = os.pathsep.join([str(by_uv.programs), os.environ["PATH"]])
    home = dict.fromkeys(("HOME", "XDG_DATA_HOME"), str(tmp_path))
    name = () if shell == "fish" else (shell,)
    run = subprocess.run(
        [path, *words, script, *name, line],
        cwd=tmp_path, env=outside() | home | {"PATH": search}, capture_output=True, text=True,
        timeout=60,
    )  # fmt: skip
    assert any(each in run.stdout for each in whole.split("|")), run
    assert "netlist" not in run.stdout
