"""The command line, run inside the test's own process, and as a process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from taction.cli.main import main
from tests.support.paths import ROOT

# Where no file may be large, Python of before 3.12.8 stores its compiled modules cut short, and
# every later process that imports them ends with "marshal data too short".
NO_BYTECODE = {"PYTHONDONTWRITEBYTECODE": "1"}


def taction(*words: str) -> Result:
    return CliRunner().invoke(main, list(words))


def document(result: Result) -> Any:
    """The one JSON document on stdout; numbers that JSON does not know are refused."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    assert result.stdout, result.stderr
    return json.loads(result.stdout, parse_constant=refuse)


def python(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with these words; `options` go to `subprocess.run`, `env` beside our variables."""
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})}
    if not {"stdout", "stderr"} & options.keys():
        options["capture_output"] = True
    options = {"text": True, "cwd": ROOT, "timeout": 300, "env": variables, **options}
    return subprocess.run([sys.executable, *words], check=False, **options)


def process_id(path: Path) -> int:
    """Wait until a program has written its process id into `path`."""
    for _ in range(2000):
        if path.exists() and (text := path.read_text()).endswith("\n"):
            return int(text)
        time.sleep(0.01)
    raise AssertionError(f"{path} was not written")


def is_running(pid: int, seconds: float = 1.0) -> bool:
    """Whether the process is neither gone nor a zombie within this time."""
    status = Path(f"/proc/{pid}/status")
    for _ in range(int(100 * seconds)):
        try:
            if "\nState:\tZ" in status.read_text():
                return False
        except (FileNotFoundError, ProcessLookupError):
            return False
        time.sleep(0.01)
    return True
