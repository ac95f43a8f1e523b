"""Outputs that cannot be written are refused before any work is done."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.verification.report.output_checks import check_folder, check_separate


@pytest.mark.parametrize(("name", "word"), [("missing/x.json", "does not exist"), (".", "folder")])
def test_a_place_that_cannot_be_written_is_named_beforehand(
    tmp_path: Path, name: str, word: str
) -> None:
    with pytest.raises(InputError, match=word):
        check_folder(tmp_path / name, "--junit")


def test_devices_may_be_shared(tmp_path: Path) -> None:
    check_separate([], {"--junit": "/dev/null", "--markdown": "/dev/null"})
    file = str(tmp_path / "a")
    with pytest.raises(InputError, match="the file of --junit of the same command"):
        check_separate([], {"--junit": file, "--markdown": file})
