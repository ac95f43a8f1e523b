"""The examples in the docstrings of the designing commands give what they say."""

from __future__ import annotations

import doctest
from types import ModuleType

import pytest

from netlist_gen.board import buyable_values, part_warnings
from netlist_gen.scene import writing
from tests.support.paths import ROOT
from verification.report.verdict import remedies
from verification.studies import tuning_ranges
from verification.studies.choose import request
from verification.studies.remedies import stable_ranges
from verification.studies.scaling import scaling

MODULES = (
    buyable_values,
    part_warnings,
    remedies,
    request,
    scaling,
    stable_ranges,
    tuning_ranges,
    writing,
)


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_examples(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(module)
    assert result.attempted
    assert not result.failed
