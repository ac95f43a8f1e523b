"""Files of samples: what they refuse, and what a kill may leave behind."""

from __future__ import annotations

import errno
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from spice_models.errors import InputError, OutOfDisk
from tests.support.studying import small_scene
from verification.studies.tolerance.sample_file import SampleFile
from verification.studies.tolerance.varied_board import Sample, Study, prepare

STUDY = prepare(small_scene())
SAMPLES = [Sample(0, "pass", settling_time=1e-6), Sample(2, "fail", ("stability",), margin=1.5)]


def filled(path: Path, study: Study = STUDY, seed: int = 1) -> str:
    with SampleFile(str(path), study, seed) as file:
        for sample in SAMPLES:
            file.append(sample)
    return str(path)


def test_what_was_appended_is_read_again(tmp_path: Path) -> None:
    path = filled(tmp_path / "a")
    with SampleFile(path, STUDY, 1) as file:
        assert file.samples == {0: SAMPLES[0], 2: SAMPLES[1]}


@pytest.mark.parametrize("cut", [1, 10, 30])
def test_a_last_line_cut_short_is_dropped(tmp_path: Path, cut: int) -> None:
    path = Path(filled(tmp_path / "a"))
    path.write_bytes(path.read_bytes()[:-cut])
    with SampleFile(str(path), STUDY, 1) as file:
        assert file.samples == {0: SAMPLES[0]}
        file.append(SAMPLES[1])
    with SampleFile(str(path), STUDY, 1) as file:
        assert set(file.samples) == {0, 2}


def test_a_first_line_cut_short_is_begun_again(tmp_path: Path) -> None:
    path = Path(filled(tmp_path / "a"))
    path.write_bytes(path.read_bytes()[:25])
    with SampleFile(str(path), STUDY, 1) as file:
        assert file.samples == {}
    assert json.loads(path.read_text())["seed"] == 1


@pytest.mark.parametrize(
    ("seed", "tables", "what"),
    [
        (2, {}, "another seed"),
        (1, {"checks": {"steady_state": {"tolerance": 0.1}}}, "another scene"),
    ],
)
def test_samples_of_something_else_are_refused(
    tmp_path: Path, seed: int, tables: dict[str, Any], what: str
) -> None:
    path = filled(tmp_path / "a")
    before = Path(path).read_bytes()
    with pytest.raises(InputError, match=f"holds samples of {what}"):
        SampleFile(path, prepare(small_scene(**tables)), seed)
    assert Path(path).read_bytes() == before


def test_samples_of_another_taction_are_refused(tmp_path: Path) -> None:
    versions = replace(STUDY.versions, code=b"another state of the source")
    path = filled(tmp_path / "a", replace(STUDY, versions=versions))
    with pytest.raises(InputError, match="holds samples of another taction or ngspice"):
        SampleFile(path, STUDY, 1)


@pytest.mark.parametrize("text", ["hello\n", "hello", "{}\n", "[1]\n", '"x"\n', "\x00\xff\n"])
def test_a_foreign_file_is_refused_and_left_alone(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a"
    path.write_text(text, encoding="latin-1")
    before = path.read_bytes()
    with pytest.raises(InputError, match="holds no samples of taction"):
        SampleFile(str(path), STUDY, 1)
    assert path.read_bytes() == before


@pytest.mark.parametrize("line", [b"", b"{}", b"[]", b'{"number": 1}', b"\xff\xfe"])
def test_a_damaged_line_is_named(tmp_path: Path, line: bytes) -> None:
    path = Path(filled(tmp_path / "a"))
    head, *rest = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([head, line, *rest]))
    with pytest.raises(InputError, match="line 2 is damaged"):
        SampleFile(str(path), STUDY, 1)


def test_two_runs_do_not_share_a_file(tmp_path: Path) -> None:
    path = str(tmp_path / "a")
    with SampleFile(path, STUDY, 1), pytest.raises(InputError, match="another run is writing it"):
        SampleFile(path, STUDY, 1)
    with SampleFile(path, STUDY, 1) as file:
        assert file.samples == {}


def test_a_file_that_cannot_be_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a file that can be written"):
        SampleFile(str(tmp_path / "nowhere" / "a"), STUDY, 1)


def test_a_full_disk_is_said_and_nothing_is_lost(tmp_path: Path) -> None:
    path = filled(tmp_path / "a")
    with SampleFile(path, STUDY, 1) as file:

        class Full:
            def write(self, text: bytes) -> int:
                raise OSError(errno.ENOSPC, "No space left on device")

            def close(self) -> None:
                pass

        real, file._file = file._file, Full()  # type: ignore[assignment] # a disk that is full
        with pytest.raises(OutOfDisk, match="No space left on device; the 2 samples before stay"):
            file.append(Sample(3, "pass"))
        real.close()
    with SampleFile(path, STUDY, 1) as file:
        assert set(file.samples) == {0, 2}
