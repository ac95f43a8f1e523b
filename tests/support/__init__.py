"""What several tests share: boards, scenes, oracles, running the command."""

from __future__ import annotations

from typing import Any

import pytest


def nightly(*cases: Any) -> list[Any]:
    """Cases of a parametrised test that only `make nightly` runs; a tuple is of several arguments.

    For what takes long and finds what the other cases do not only rarely.
    """
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.nightly)
        for case in cases
    ]
