"""The README is short, and what it names exists."""

from __future__ import annotations

import re

from tests.support.paths import ROOT
from tests.support.running import taction

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_has_at_most_90_lines() -> None:
    assert len(README.splitlines()) <= 90


def test_every_page_and_picture_that_it_names_exists() -> None:
    named = set(re.findall(r"(?:docs|scenes)/[\w./-]+\.\w+", README))
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_screen_that_it_shows_is_that_of_the_command() -> None:
    shown = re.findall(r"^```\n(PASS: .*?)^```$", README, re.MULTILINE | re.DOTALL)
    lines = shown[0].splitlines()
    printed = taction("verify", str(ROOT / "scenes" / "paper-breadboard.toml")).stdout.splitlines()
    assert len(lines) > 8
    assert [line for line in lines if line not in printed] == []
