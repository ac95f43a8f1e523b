"""Every planted fault of the judging changes the result of a board that must not pass."""

from __future__ import annotations

import pytest

from taction.verification.verdict.verify import verify
from tests.mutation.judging import BUDGET, MISJUDGEMENTS, Misjudgement, too_strict
from tests.mutation.table import PAGE, page_with

pytestmark = pytest.mark.usefixtures("ngspice")


@pytest.mark.parametrize("fault", MISJUDGEMENTS, ids=lambda each: each.fault)
def test_a_board_that_must_not_pass_is_judged_right(fault: Misjudgement) -> None:
    assert fault.found(faulty=False) == fault.right
    assert fault.right != "pass"


@pytest.mark.parametrize("fault", MISJUDGEMENTS, ids=lambda each: each.fault)
def test_a_fault_of_the_judging_shows(fault: Misjudgement) -> None:
    assert fault.found(faulty=True) != fault.right


def test_the_board_of_the_budget_does_not_pass() -> None:
    assert [each.caught_by for each in MISJUDGEMENTS].count(BUDGET) == 1
    assert verify(too_strict()).outcome.value == "fail"


def test_the_page_shows_these_faults() -> None:
    text = PAGE.read_text("utf-8")
    assert page_with(text) == text, "run: python -m tests.mutation.table"
    assert all(each.fault in text for each in MISJUDGEMENTS)
