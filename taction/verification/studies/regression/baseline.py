"""The baseline of a regression run: a JSON file with one entry per scene.

Nothing depends on the time of the run, so the same results give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

from taction.netlist_gen.scene.keys import all_keys, files_of
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import INLINE, plain, read
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.quantities import written
from taction.system.reading_definitions import READINGS
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import Verdict

FORMAT = 4
MARK = "taction_baseline"
MOVE_AWAY = "rename it, and `--update` writes a new baseline"


ALWAYS = ("step_amplitude", "growth_rate", "frequency", "margin")
STABLE = ("settling_time",)  # of a stable board: the record of another one grows from rounding
CHANNEL_ALWAYS = ("reference",)
CHANNEL_STABLE = ("final", *READINGS)


@dataclass(frozen=True, slots=True)
class Entry:
    """The stored results of one scene."""

    name: str
    fingerprint: str  # SHA-256 of the scene and its files, without the tolerances
    taction: str  # version
    solved_by: str  # engine with its version, matrix solver and integration method
    speed: Annotated[float, "1/s"]  # magnitude of the rightmost pole, 1/s
    # What is compared: `ALWAYS`, `STABLE` and the same of the channels.
    record: Annotated[Record, INLINE]
    # The keys that the scene gives, with their values as it could write them; empty in a baseline
    # of an older taction.
    keys: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.record.value("growth_rate") is None:
            raise ValueError("growth_rate is missing")

    @property
    def stable(self) -> bool:
        """Whether the board has no growing mode."""
        rate = self.record.value("growth_rate")
        return rate is not None and rate < 0.0

    @property
    def checks(self) -> dict[str, str]:
        """Outcomes by the names of the checks."""
        return {check.name: check.outcome.value for check in self.record.checks}


Baseline = Mapping[str, Entry]
"""Entries by the name of the scene's file."""


def observe(verdict: Verdict) -> Entry:
    """Return the entry of a verdict."""
    return Entry(
        name=verdict.scene.name,
        fingerprint=fingerprint(verdict.scene),
        taction=metadata.version("taction"),
        solved_by=verdict.waveforms.simulator,
        speed=abs(verdict.poles.rightmost),
        record=Record.of(verdict).without_run_time(),
        keys=written_keys(verdict.scene),
    )


def fingerprint(scene: Scene) -> str:
    """Return the SHA-256 of a scene as written, without its tolerances, and of its files."""
    digest = hashlib.sha256(json.dumps(_written(scene), sort_keys=True).encode())
    for name in files_of(scene).values():
        if isinstance(name, str):  # an array is in what was written
            digest.update(read_bounded(scene.folder / name, LARGEST))
    return digest.hexdigest()


def _written(scene: Scene) -> dict[str, Any]:
    return scene.model_dump(mode="json", exclude_unset=True, exclude={"regression"}, by_alias=True)


def written_keys(scene: Scene) -> dict[str, str]:
    """Return the keys that a scene gives, as it could write them; a list has only its length."""
    units = {key.path: key.unit for key in all_keys(scene)}

    def texts(table: dict[str, Any], above: str) -> Iterator[tuple[str, str]]:
        for name, value in table.items():
            path = above + name
            if isinstance(value, dict):
                yield from texts(value, f"{path}.")
            elif isinstance(value, list):
                yield path, f"{len(value)} values"
            elif isinstance(value, float) and units.get(path):
                yield path, written(value, units[path]).strip('"')
            else:
                yield path, str(value)

    return dict(texts(_written(scene), ""))


@dataclass(frozen=True, slots=True)
class BaselineFile:
    """What is in the file of a baseline."""

    taction_baseline: int  # the format
    scenes: dict[str, Entry]


def load_baseline(path: str | Path) -> dict[str, Entry]:
    """Read the entries of a baseline, or refuse a file that is none, or that is damaged."""

    def unusable(key: str, value: str, reason: str) -> InputError:
        return InputError(path, Complaint(key, value, reason))

    damaged = f"; restore the file, or {MOVE_AWAY}"
    try:
        data = json.loads(read_bounded(Path(path), LARGEST))
    except UnusableFileError as error:
        raise unusable("baseline", "", f"{error}; `--update` writes a baseline") from None
    except (ValueError, RecursionError) as error:
        raise unusable("baseline", "", f"damaged, no JSON: {error}{damaged}") from None
    if not isinstance(data, dict) or MARK not in data:
        reason = f"JSON, but no baseline of taction ('{MARK}' is missing); give another file"
        raise unusable("baseline", "", reason)
    if data[MARK] != FORMAT:
        reason = f"another format; this taction reads {FORMAT}. Use the taction that wrote it, or "
        raise unusable(MARK, repr(data[MARK]), reason + MOVE_AWAY)
    try:
        found = read(BaselineFile, data)
        if json.loads(baseline_text(found.scenes)) != data:
            raise ValueError("scenes: has a key that no baseline has, or lacks one")
    except ValueError as error:
        place, _, what = str(error).rpartition(": ")
        raise unusable(place or "scenes", "", f"damaged: {what}{damaged}") from None
    return found.scenes


def baseline_text(entries: Baseline) -> str:
    """Return a baseline as the text of its file."""
    file = {MARK: FORMAT, "scenes": dict(sorted(entries.items()))}
    return json.dumps(plain(file), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
