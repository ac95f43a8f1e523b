"""Report files: self-contained, escaped, small, and refused before any work where impossible."""

from __future__ import annotations

import base64
import gzip
import hashlib
import importlib.util
import re
from importlib.resources import files
from pathlib import Path

import pytest
from lxml import html

from taction.verification.report.blocks import Facts, Page, Section
from taction.verification.report.renderers.notebook import card
from taction.verification.report.renderers.page import page_html
from tests.support.entries import write_fast
from tests.support.report_pages import HOSTILE, hostile, page
from tests.support.running import taction as command

MOST = 6_000_000  # bytes
SAMPLE = ("passing", "exponential", "64 channels", "sweep, a map", "regress")


def small(text: str = "1") -> Page:
    return Page("a", "b", "pass", "c", (), (Section("d", (Facts("", (("e", text),)),)),))


@pytest.mark.parametrize("name", SAMPLE)
def test_a_report_names_nothing_outside_itself_and_is_small(name: str) -> None:
    text = page_html(page(name))
    assert len(text.encode()) < MOST
    tree = html.document_fromstring(text)
    assert not tree.xpath("//*[@src] | //link | //iframe | //object | //*[starts-with(@href, 'h')]")
    assert [a for a in tree.xpath("//@href") if not a.startswith("#")] == []
    style = tree.xpath("string(//style)")
    assert "@import" not in style
    assert re.findall(r"url\((?!#)", style) == []


def test_the_policy_lets_only_the_two_programs_of_the_page_run() -> None:
    tree = html.document_fromstring(page_html(page("passing")))
    (policy,) = tree.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    (program,) = tree.xpath("//script[not(@type)]/text()")
    (packed,) = tree.xpath("//script[@id='plotly']/text()")
    plotly = gzip.decompress(base64.b64decode(packed))
    assert plotly == (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    for text in (program.encode(), plotly):
        assert base64.b64encode(hashlib.sha256(text).digest()).decode() in policy
    assert "default-src 'none'" in policy
    assert "script-src 'sha256-" in policy
    assert "unsafe-eval" not in policy
    assert "http" not in policy


def test_texts_are_never_markup() -> None:
    text = page_html(hostile())
    tree = html.document_fromstring(text)
    assert HOSTILE not in text
    assert HOSTILE not in card(hostile())
    assert "<script>window" not in text
    assert "<img" not in text
    kinds = [each.get("type") or each.get("id") for each in tree.xpath("//script")]
    assert kinds.count(None) == 1
    assert HOSTILE in tree.text_content()


def test_missing_packages_are_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    absent = {"plotly", "jinja2"}
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name in absent else find(name)
    )
    scene, out = write_fast(tmp_path / "a.toml"), tmp_path / "a.html"
    run = command("verify", str(scene), "--report", str(out))
    assert run.exit_code == 2
    assert "needs jinja2 and plotly: pip install 'taction[report]'" in run.output
    assert not out.exists()
