"""The campaign notices a fault, a wait and too much memory, and keeps the input."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT

WORKER = """
import json, time
from pathlib import Path
from hypothesis import strategies as st
from tests.fuzz import campaign, targets
from tests.fuzz.target import Target
from taction.system.errors import Complaint, InputError

def examine(content, folder):
    {body}

targets.TARGETS["demo"] = Target("demo", st.binary(min_size=1, max_size=3), examine)
campaign.LONGEST = 1.0
print(json.dumps(campaign.work("demo", 1, 20, Path("current"))))
"""


def worker(folder: Path, body: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", WORKER.format(body=body)],
        cwd=folder,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


REFUSED = "if content[0] % 2: raise InputError('x', Complaint('key', '', 'a number'))"


@pytest.mark.parametrize(
    ("body", "outcomes", "kept"),
    [
        (f"{REFUSED}\n    return 'accepted'", {"accepted", "refused: InputError"}, 0),
        ("return str(1 // 0)", {"FAULT: ZeroDivisionError"}, 1),
        ("raise InputError('x')", {"FAULT: AssertionError"}, 1),  # an error without words
        ("return str(len(bytearray(3_000_000_000)))", {"FAULT: MemoryError"}, 1),
    ],
)
def test_outcomes_are_counted_and_the_input_of_a_fault_is_kept(
    body: str, outcomes: set[str], kept: int, tmp_path: Path
) -> None:
    counts = json.loads(worker(tmp_path, body).stdout)
    assert {outcome.split(" at ")[0] for outcome in counts} == outcomes
    assert sum(counts.values()) == 20
    files = list((tmp_path / "fuzz-failures").glob("*"))
    assert len(files) == kept
    assert all(1 <= file.stat().st_size <= 3 for file in files)


def test_a_wait_ends_the_worker_with_its_input_on_the_disk(tmp_path: Path) -> None:
    done = worker(tmp_path, "time.sleep(60.0)")
    assert done.returncode != 0
    assert "Timeout" in done.stderr
    assert (tmp_path / "current").stat().st_size >= 1
