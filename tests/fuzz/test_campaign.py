"""The campaign notices a fault, a wait and too much memory, and keeps the input."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT

WORKER = """
import json, os, sys, time
from pathlib import Path
from hypothesis import strategies as st
from tests.fuzz import campaign, targets
from tests.fuzz.target import Target
from taction.system.errors import Complaint, InputError

def work(body):
    exec("def examine(content, folder):\\n    " + body, globals())
    targets.TARGETS["demo"] = Target("demo", st.binary(min_size=1, max_size=3), examine)
    return campaign.work("demo", 1, 20, Path("current"))

campaign.LONGEST = 1.0
for k, body in enumerate(sys.argv[1:]):  # each in a folder and with the limits of its own
    if child := os.fork():
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        continue
    os.mkdir(str(k))
    os.chdir(str(k))
    print(json.dumps(work(body)), flush=True)
    os._exit(0)
sys.exit(status)
"""


def worker(folder: Path, *bodies: str) -> subprocess.CompletedProcess[str]:
    """Run a worker of each body of a target, by one start; the status is that of the last."""
    return subprocess.run(
        [sys.executable, "-c", WORKER, *bodies],
        cwd=folder,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


REFUSED = "if content[0] % 2: raise InputError('x', Complaint('key', '', 'a number'))"
CASES = (  # body of a target, outcomes, files that are kept
    (f"{REFUSED}\n    return 'accepted'", {"accepted", "refused: InputError"}, 0),
    ("return str(1 // 0)", {"FAULT: ZeroDivisionError"}, 1),
    ("raise InputError('x')", {"FAULT: AssertionError"}, 1),  # an error without words
    ("return str(len(bytearray(3_000_000_000)))", {"FAULT: MemoryError"}, 1),
)


def test_outcomes_are_counted_and_the_input_of_a_fault_is_kept(tmp_path: Path) -> None:
    said = worker(tmp_path, *(body for body, _, _ in CASES)).stdout.splitlines()
    for k, (line, (_, outcomes, kept)) in enumerate(zip(said, CASES, strict=True)):
        counts = json.loads(line)
        assert {outcome.split(" at ")[0] for outcome in counts} == outcomes
        assert sum(counts.values()) == 20
        files = list((tmp_path / str(k) / "fuzz-failures").glob("*"))
        assert len(files) == kept
        assert all(1 <= file.stat().st_size <= 3 for file in files)


def test_a_wait_ends_the_worker_with_its_input_on_the_disk(tmp_path: Path) -> None:
    done = worker(tmp_path, "time.sleep(60.0)")
    assert done.returncode != 0
    assert "Timeout" in done.stderr
    assert (tmp_path / "0" / "current").stat().st_size >= 1
