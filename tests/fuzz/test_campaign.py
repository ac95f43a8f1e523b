"""The campaign notices a fault and a wait, and keeps the input."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT

WORKER = """
import json, sys, time
from pathlib import Path
from hypothesis import strategies as st
from tests.fuzz import campaign, targets
from tests.fuzz.target import Target
from taction.system.errors import Complaint, InputError

def examine(content, folder):
    if content == b"wait":
        time.sleep(60.0)
    if content == b"greedy":
        return str(len(bytearray(3_000_000_000)))
    if content == b"silent":  # an error without words
        raise InputError("x")
    if content == b"refused":
        raise InputError("x", Complaint("key", "", "a number"))
    return str(1 // (content != b"fault"))

campaign.LONGEST = 1.0
for words in (["good", "refused", "fault", "silent", "greedy"], ["wait"]):
    inputs = st.sampled_from([word.encode() for word in words])
    targets.TARGETS["demo"] = Target("demo", inputs, examine)
    print(json.dumps(campaign.work("demo", 1, 40, Path("current"))), flush=True)
    campaign._limit_memory = lambda: None  # no process can raise its limit again
"""


def test_a_fault_is_counted_and_its_input_kept_and_a_wait_ends_the_worker(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WORKER],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    counts = {outcome.split(" at ")[0] for outcome in json.loads(done.stdout)}
    faults = {f"FAULT: {kind}" for kind in ("ZeroDivisionError", "AssertionError", "MemoryError")}
    assert counts == {"1", "refused: InputError", *faults}
    kept = {file.read_bytes() for file in (tmp_path / "fuzz-failures").iterdir()}
    assert kept == {b"fault", b"silent", b"greedy"}
    assert done.returncode != 0
    assert "Timeout" in done.stderr
    assert (tmp_path / "current").read_bytes() == b"wait"
