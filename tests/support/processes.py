"""Other processes: whether they run."""

from __future__ import annotations

import time
from pathlib import Path


def process_id(path: Path) -> int:
    """Wait until a program has written its process id into `path`."""
    for _ in range(2000):
        if path.exists() and (text := path.read_text()).endswith("\n"):
            return int(text)
        time.sleep(0.01)
    raise AssertionError(f"{path} was not written")


def is_running(pid: int) -> bool:
    """Whether the process is neither gone nor a zombie within a second."""
    status = Path(f"/proc/{pid}/status")
    for _ in range(100):
        try:
            if "\nState:\tZ" in status.read_text():
                return False
        except (FileNotFoundError, ProcessLookupError):
            return False
        time.sleep(0.01)
    return True
