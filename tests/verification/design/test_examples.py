"""The examples in the docstrings of the designing commands give what they say."""

from __future__ import annotations

import doctest
from types import ModuleType

import pytest

from taction.netlist_gen.board import part_warnings, preferred_values
from taction.netlist_gen.scene import writing
from taction.verification.design import choose, ranges, scaling, stable_ranges
from taction.verification.report.verdict import remedies
from tests.support.paths import ROOT

MODULES = (
    preferred_values,
    part_warnings,
    remedies,
    choose,
    scaling,
    stable_ranges,
    ranges,
    writing,
)


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_examples(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(module)
    assert result.attempted
    assert not result.failed
