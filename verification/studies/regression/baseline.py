"""The baseline of a regression run: a JSON file with one entry per scene.

The file contains no date and no run time: the same results give the same bytes.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import pydantic_core
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded

FORMAT = 1
MARK = "taction_baseline"
UNKNOWN = "unknown"
MOVE_AWAY = "rename it, and `--update` writes a new baseline"

Finite = Annotated[float, Field(allow_inf_nan=False)]


class Entry(BaseModel):
    """The stored results of one scene.

    A time in `times` has two values where a small change of a level moves it, and null where the
    board lacks it. An unstable board has no samples: its transient grows from rounding errors.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)  # "1" is no number

    name: str  # of the scene
    fingerprint: str  # SHA-256 of the scene and its files, without the tolerances
    revision: str  # git commit
    taction: str  # version
    simulator: str  # engine with its version, matrix solver and integration method
    outcome: Literal["pass", "fail", "inconclusive"]
    checks: dict[str, Literal["pass", "fail", "inconclusive"]]
    amplitude: Finite  # step amplitude, V
    speed: Finite  # magnitude of the rightmost pole, 1/s
    # "u_1.target", "u_1.final" in V; "u_1.overshoot" and the like in step amplitudes
    levels: dict[str, Finite]
    times: dict[str, Annotated[list[Finite | None], Field(min_length=1)]]  # s
    poles: dict[str, Finite]  # "growth_rate" in 1/s, "frequency" in Hz, "margin"
    states: dict[str, str]  # final state of each output
    time: list[Finite]  # s
    outputs: dict[str, list[Finite]]  # samples at `time`, V

    @property
    def stable(self) -> bool:
        """Whether the board has no growing mode."""
        return self.poles["growth_rate"] < 0.0

    @model_validator(mode="after")
    def _check_samples(self) -> Self:
        if "growth_rate" not in self.poles:
            raise ValueError("growth_rate of the poles is missing")
        if any(b <= a for a, b in zip(self.time[:-1], self.time[1:], strict=True)):
            raise ValueError("the time does not increase")
        if any(len(samples) != len(self.time) for samples in self.outputs.values()):
            raise ValueError("an output and the time differ in length")
        return self


Baseline = Mapping[str, Entry]
"""Entries by the name of the scene's file."""


def load_baseline(path: str | Path) -> dict[str, Entry]:
    """Read a baseline.

    Raises
    ------
    InputError
        The file cannot be read, is damaged, is no baseline, or has another format.
    """
    path = Path(path)
    try:
        text = read_bounded(path, LARGEST)
    except UnusableFileError as error:
        reason = f"{error}; `--update` writes a baseline"
        raise InputError(path, Complaint("baseline", "", reason)) from None
    try:
        data = pydantic_core.from_json(text)
    except ValueError as error:
        reason = f"damaged, no JSON: {error}; restore the file, or {MOVE_AWAY}"
        raise InputError(path, Complaint("baseline", "", reason)) from None
    if not isinstance(data, dict) or MARK not in data:
        reason = f"JSON, but no baseline of taction ('{MARK}' is missing); give another file"
        raise InputError(path, Complaint("baseline", "", reason))
    if data[MARK] != FORMAT:
        reason = f"another format; this taction reads {FORMAT}. Use the taction that wrote it, or "
        raise InputError(path, Complaint(MARK, repr(data[MARK]), reason + MOVE_AWAY))
    return _entries(data, path)


def baseline_text(entries: Baseline) -> str:
    """Return a baseline as the text of its file."""
    scenes = {name: entries[name].model_dump() for name in sorted(entries)}
    return "".join(_pretty({MARK: FORMAT, "scenes": scenes})) + "\n"


def git_revision(folder: Path) -> str:
    """Return the commit checked out in the repository of `folder`, or ``"unknown"``."""
    git = shutil.which("git")
    if git is None:
        return UNKNOWN
    try:
        run = subprocess.run(
            [git, "-C", str(folder), "rev-parse", "--verify", "HEAD"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=20.0,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return UNKNOWN
    return run.stdout.strip() if run.returncode == 0 else UNKNOWN


def _entries(data: dict[str, Any], path: Path) -> dict[str, Entry]:
    scenes = data.get("scenes")
    if not isinstance(scenes, dict):
        reason = f"damaged: expected a table of scenes; restore the file, or {MOVE_AWAY}"
        raise InputError(path, Complaint("scenes", "", reason))
    entries, complaints = {}, []
    for name, entry in scenes.items():
        try:
            entries[name] = Entry.model_validate(entry)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(map(str, ("scenes", name, *first["loc"])))
            reason = f"damaged: {first['msg']}; restore the file, or {MOVE_AWAY}"
            complaints.append(Complaint(key, "", reason))
    if complaints:
        raise InputError(path, *complaints)
    return entries


def _pretty(value: Any, indent: str = "\n") -> Iterator[str]:
    """Yield JSON with one line per key, so that a diff of two baselines can be read."""
    if not isinstance(value, dict) or not value:
        yield json.dumps(value, ensure_ascii=False, allow_nan=False)
        return
    yield "{"
    for number, (key, item) in enumerate(value.items()):
        yield f"{',' if number else ''}{indent}  {json.dumps(key, ensure_ascii=False)}: "
        yield from _pretty(item, indent + "  ")
    yield indent + "}"
