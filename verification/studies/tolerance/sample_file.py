"""Samples in a file of JSON lines, kept as they come: a run that is killed goes on from there.

The first line says what the samples are of. A last line that a kill cut short is dropped.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from spice_models.errors import Complaint, InputError, OutOfDisk
from verification.studies.running.digests import digest
from verification.studies.tolerance.varied_board import Sample, Study

KIND = "taction samples 1"
_OTHERS = {"study": "scene", "seed": "seed", "versions": "taction or ngspice"}
_FIELDS = {field.name for field in fields(Sample)}


class SampleFile:
    """A file of samples of one study and seed; a context manager that closes it.

    Parameters
    ----------
    path : str
        A file of an earlier run, or a name that is free.

    Raises
    ------
    InputError
        The file holds something else, is damaged, is in use, or cannot be written.
    """

    def __init__(self, path: str, study: Study, seed: int) -> None:
        self.path = path
        self.samples: dict[int, Sample] = {}
        content = digest(study.scene, study.problem.matrix, study.problem.strain, study.nominal)
        versions = digest(study.versions).hex()
        head = {"kind": KIND, "study": content.hex(), "seed": seed, "versions": versions}
        try:
            self._file: IO[bytes] = Path(path).open("a+b")  # noqa: SIM115 - open as long as self
        except OSError as error:
            raise self._refused(f"{error.strerror}; expected a file that can be written") from None
        try:
            self._lock()
            self._read(head)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> SampleFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def append(self, sample: Sample) -> None:
        """Keep a sample at once.

        Raises
        ------
        OutOfDisk
            The file cannot grow; what it held before stays.
        """
        self.samples[sample.number] = sample
        self._write(asdict(sample))

    def _write(self, record: dict[str, Any]) -> None:
        try:
            self._file.write(json.dumps(record).encode() + b"\n")
            self._file.flush()
        except OSError as error:
            raise OutOfDisk(
                f"{self.path}: {error.strerror}; the {len(self.samples) - 1} samples before stay,"
                " the same command goes on from there"
            ) from None

    def _lock(self) -> None:
        """Two runs would both compute what is missing, and write between each other's lines."""
        if sys.platform == "win32":
            return
        import fcntl

        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = "another run is writing it; wait for it, or give another name"
            raise self._refused(text) from None

    def _read(self, head: dict[str, Any]) -> None:
        self._file.seek(0)
        lines = self._file.read().split(b"\n")
        whole = lines[:-1]  # what follows the last line's end was cut short
        if not whole:
            started = json.dumps(head).encode()
            if lines[0] and not started.startswith(lines[0]):
                raise self._refused("holds no samples of taction; give another name")
            self._file.truncate(0)
            self._write(head)
            return
        self._check_head(whole[0], head)
        for number, line in enumerate(whole[1:], start=2):
            sample = _parsed(line)
            if sample is None:
                text = f"line {number} is damaged; delete that line, or give another name"
                raise self._refused(text)
            self.samples[sample.number] = sample
        self._file.truncate(sum(len(line) + 1 for line in whole))

    def _check_head(self, line: bytes, head: dict[str, Any]) -> None:
        try:
            found = json.loads(line)
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get("kind") != KIND:
            raise self._refused("holds no samples of taction; give another name")
        if found != head:
            what = next(text for key, text in _OTHERS.items() if found.get(key) != head[key])
            raise self._refused(f"holds samples of another {what}; delete it, or another name")

    def _refused(self, text: str) -> InputError:
        return InputError("-o", Complaint("FILE", repr(self.path), text))


def _parsed(line: bytes) -> Sample | None:
    try:
        record = json.loads(line)
    except ValueError:
        return None
    if not isinstance(record, dict) or set(record) != _FIELDS:
        return None
    lists = {name: record[name] for name in ("failed", "errors")}
    if not isinstance(record["number"], int) or not all(
        isinstance(x, list) for x in lists.values()
    ):
        return None
    return Sample(**(record | {name: tuple(each) for name, each in lists.items()}))
