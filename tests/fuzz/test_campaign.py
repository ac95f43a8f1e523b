"""The campaign notices a fault, a wait and too much memory, and keeps the input."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

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


def test_outcomes_are_counted(tmp_path: Path) -> None:
    body = "if content[0] % 2: raise InputError('x', Complaint('key', '', 'a number'))"
    counts = json.loads(worker(tmp_path, f"{body}\n    return 'accepted'").stdout)
    assert set(counts) == {"accepted", "refused: InputError"}
    assert sum(counts.values()) == 20
    assert not (tmp_path / "fuzz-failures").exists()


def test_an_exception_is_a_fault_and_its_input_is_kept(tmp_path: Path) -> None:
    counts = json.loads(worker(tmp_path, "return str(1 // 0)").stdout)
    (outcome,) = counts
    assert outcome.startswith("FAULT: ZeroDivisionError at ")
    (kept,) = (tmp_path / "fuzz-failures").iterdir()
    assert 1 <= kept.stat().st_size <= 3


def test_an_error_without_words_is_a_fault(tmp_path: Path) -> None:
    counts = json.loads(worker(tmp_path, "raise InputError('x')").stdout)
    assert [outcome.split(" at ")[0] for outcome in counts] == ["FAULT: AssertionError"]


def test_too_much_memory_is_a_fault(tmp_path: Path) -> None:
    counts = json.loads(worker(tmp_path, "return str(len(bytearray(3_000_000_000)))").stdout)
    assert [outcome.split(" at ")[0] for outcome in counts] == ["FAULT: MemoryError"]


def test_a_wait_ends_the_worker_with_its_input_on_the_disk(tmp_path: Path) -> None:
    done = worker(tmp_path, "time.sleep(60.0)")
    assert done.returncode != 0
    assert "Timeout" in done.stderr
    assert (tmp_path / "current").stat().st_size >= 1
