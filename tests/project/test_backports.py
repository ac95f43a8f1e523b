"""The backports entry is a copy of the machine's own, in either format of apt sources."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT

SCRIPT = ROOT / "scripts" / "backports.py"
URI = "http://mirror.example/debian/"

PARAGRAPHS = """\
# the distribution
Types: deb deb-src
URIs: https://other.example/debian http://mirror.example/debian
Suites: bookworm bookworm-updates
Components: main contrib
Signed-By:
 -----BEGIN PGP PUBLIC KEY BLOCK-----
 .
 abc

Types: deb
URIs: http://mirror.example/debian-security
Suites: bookworm-security
Components: main
"""


def run(apt: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), "bookworm", URI, str(apt)], capture_output=True, text=True
    )


@pytest.fixture
def apt(tmp_path: Path) -> Path:
    (tmp_path / "sources.list.d").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("line", "entry"),
    [
        (
            "deb http://mirror.example/debian bookworm main contrib",
            "deb http://mirror.example/debian bookworm-backports main\n",
        ),
        (
            "deb [signed-by=/k.gpg arch=amd64] http://mirror.example/debian/ bookworm main",
            "deb [signed-by=/k.gpg arch=amd64] http://mirror.example/debian/ "
            "bookworm-backports main\n",
        ),
    ],
)
def test_one_line_entries_keep_their_options(apt: Path, line: str, entry: str) -> None:
    (apt / "sources.list").write_text(
        "# deb http://mirror.example/debian sid main\n"
        "deb cdrom:[Debian 12]/ bookworm main\n"
        f"deb-src {URI} bookworm main\n{line}\n"
    )
    written = Path(run(apt).stdout.strip())
    assert written == apt / "sources.list.d" / "taction-bookworm-backports.list"
    assert written.read_text() == entry


def test_paragraphs_keep_their_key(apt: Path) -> None:
    (apt / "sources.list.d" / "debian.sources").write_text(PARAGRAPHS)
    written = Path(run(apt).stdout.strip())
    assert written.suffix == ".sources"
    assert written.read_text() == (
        "Types: deb\n"
        "Uris: http://mirror.example/debian\n"
        "Suites: bookworm-backports\n"
        "Components: main\n"
        "Signed-By: \n -----BEGIN PGP PUBLIC KEY BLOCK-----\n .\n abc\n"
    )


@pytest.mark.parametrize(
    "text",
    ["", PARAGRAPHS.replace("Types: deb deb-src", "Enabled: no\nTypes: deb"), "Suites: bookworm\n"],
)
def test_without_a_usable_entry_nothing_is_written(apt: Path, text: str) -> None:
    (apt / "sources.list.d" / "debian.sources").write_text(text)
    result = run(apt)
    assert result.returncode == 1
    assert result.stdout == ""
    assert not list((apt / "sources.list.d").glob("taction-*"))
