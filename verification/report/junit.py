"""Test suites as JUnit XML, as the reporters of Jenkins, GitLab and GitHub read it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal
from xml.etree import ElementTree as ET

# Characters that XML 1.0 cannot hold; the log of a simulator may contain them.
FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
COUNTS = (("failures", "failure"), ("errors", "error"), ("skipped", "skipped"))

End = Literal["", "failure", "error", "skipped"]


@dataclass(frozen=True, slots=True)
class JUnitTest:
    """One test: its end (empty for a success), a message, a longer text, its time in s."""

    name: str
    end: End = ""
    message: str = ""
    text: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class JUnitSuite:
    """The tests of one file; `properties` are shown with it."""

    name: str
    file: str
    cases: Sequence[JUnitTest]
    properties: Mapping[str, str] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """The time of all tests, s."""
        return sum(case.seconds for case in self.cases)


def junit_text(name: str, suites: Sequence[JUnitSuite]) -> str:
    """Return `suites` under a `name` as JUnit XML.

    Examples
    --------
    >>> text = junit_text("demo", [JUnitSuite("board", "board.toml", [JUnitTest("stable")])])
    >>> '<testcase name="stable" classname="taction.board"' in text
    True
    """
    root = ET.Element("testsuites", name=name)
    found = [_suite(root, suite) for suite in suites]
    for count in ("tests", "failures", "errors"):
        root.set(count, str(sum(int(suite.get(count, "0")) for suite in found)))
    root.set("time", _seconds(sum(suite.seconds for suite in suites)))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _suite(root: ET.Element, suite: JUnitSuite) -> ET.Element:
    element = ET.SubElement(root, "testsuite", name=_clean(suite.name))
    element.set("tests", str(len(suite.cases)))
    for count, end in COUNTS:
        element.set(count, str(sum(case.end == end for case in suite.cases)))
    element.set("time", _seconds(suite.seconds))
    element.set("file", _clean(suite.file))
    properties = ET.SubElement(element, "properties")
    for name, value in suite.properties.items():
        ET.SubElement(properties, "property", name=name, value=_clean(value))
    for case in suite.cases:
        test = ET.SubElement(element, "testcase", name=_clean(case.name))
        test.set("classname", _clean(f"taction.{suite.name}"))
        test.set("time", _seconds(case.seconds))
        if case.end:
            ended = ET.SubElement(test, case.end, message=_clean(case.message), type=case.end)
            ended.text = _clean(case.text)
    return element


def _seconds(seconds: float) -> str:
    return f"{seconds:.3f}"


def _clean(text: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
