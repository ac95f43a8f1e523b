"""The baseline of a regression run: one JSON file with an entry a scene.

The file holds no date and no run time: the same results give the same bytes.
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

from spice_models.errors import Complaint, InputError

FORMAT = 1
MARK = "taction_baseline"
UNKNOWN = "unknown"
MOVE_AWAY = "move it away, and `--update` writes a new one"

Finite = Annotated[float, Field(allow_inf_nan=False)]


class Entry(BaseModel):
    """What one scene gave: its outcome, its measures, its waveforms.

    Attributes
    ----------
    name : str
        The scene's name.
    fingerprint : str
        SHA-256 of what was asked for, without its tolerances.
    revision, taction, simulator : str
        The git commit, the version of taction and the engine that it came from.
    checks : dict
        Outcome of each check.
    amplitude : float
        Step amplitude, V.
    speed : float
        Magnitude of the rightmost pole, 1/s.
    levels : dict
        ``u_1.target`` and ``u_1.final`` in V, ``u_1.overshoot`` in step amplitudes.
    times : dict
        Values in s; two where a small change of a level moves the time; null: no such time.
    poles : dict
        ``growth_rate`` in 1/s and ``frequency`` in Hz of the rightmost pole; ``margin``.
    states : dict
        How each output ends.
    time, outputs : list and dict of lists
        Samples of every output over time, s and V; none of an unstable board, whose transient
        grows from rounding errors.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    fingerprint: str
    revision: str
    taction: str
    simulator: str
    outcome: Literal["pass", "fail", "inconclusive"]
    checks: dict[str, Literal["pass", "fail", "inconclusive"]]
    amplitude: Finite
    speed: Finite
    levels: dict[str, Finite]
    times: dict[str, Annotated[list[Finite | None], Field(min_length=1)]]
    poles: dict[str, Finite]
    states: dict[str, str]
    time: list[Finite]
    outputs: dict[str, list[Finite]]

    @property
    def stable(self) -> bool:
        """Whether the board has no growing mode."""
        return self.poles["growth_rate"] < 0.0

    @model_validator(mode="after")
    def _in_step(self) -> Self:
        if "growth_rate" not in self.poles:
            raise ValueError("its poles have no growth_rate")
        if any(b <= a for a, b in zip(self.time[:-1], self.time[1:], strict=True)):
            raise ValueError("its time does not increase")
        if any(len(samples) != len(self.time) for samples in self.outputs.values()):
            raise ValueError("an output has not as many samples as there are instants")
        return self


Baseline = Mapping[str, Entry]
"""Entries by the name of the scene's file."""


def load_baseline(path: str | Path) -> dict[str, Entry]:
    """Read a baseline.

    Raises
    ------
    InputError
        It cannot be read, is damaged, is no baseline, or has another format.
    """
    path = Path(path)
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        reason = "there is no such file; `--update` writes it"
        raise InputError(path, Complaint("baseline", "", reason)) from None
    except OSError as error:
        raise InputError(path, Complaint("baseline", "", str(error.strerror))) from None
    try:
        data = pydantic_core.from_json(text)
    except ValueError as error:
        reason = f"damaged, no JSON: {error}; restore it, or {MOVE_AWAY}"
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
    """Return the commit that is checked out around `folder`, or ``"unknown"``."""
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
        reason = f"damaged: expected a table of scenes; restore it, or {MOVE_AWAY}"
        raise InputError(path, Complaint("scenes", "", reason))
    entries, complaints = {}, []
    for name, entry in scenes.items():
        try:
            entries[name] = Entry.model_validate(entry)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(map(str, ("scenes", name, *first["loc"])))
            reason = f"damaged: {first['msg']}; restore it, or {MOVE_AWAY}"
            complaints.append(Complaint(key, "", reason))
    if complaints:
        raise InputError(path, *complaints)
    return entries


def _pretty(value: Any, indent: str = "\n") -> Iterator[str]:
    """Write tables over lines and lists on one, so that a version control's diff can be read."""
    if not isinstance(value, dict) or not value:
        yield json.dumps(value, ensure_ascii=False, allow_nan=False)
        return
    yield "{"
    for place, (key, item) in enumerate(value.items()):
        yield f"{',' if place else ''}{indent}  {json.dumps(key, ensure_ascii=False)}: "
        yield from _pretty(item, indent + "  ")
    yield indent + "}"
