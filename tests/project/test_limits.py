"""The sizes of what is not modelled: the code of the page gives the numbers of its table."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.support.paths import ROOT

PAGE = (ROOT / "docs" / "network.md").read_text("utf-8").partition("## Limits of validity")[2]
UNITS = {"mV": 1e-3, "uV": 1e-6, "nV": 1e-9}
ROWS = {
    "leakage": "leakage of the board",
    "hum": "hum and interference",
    "warm-up": "warm-up of the op-amps",
    "resistors": "voltage and self-heating",
    "thermoelectric": "thermoelectric voltages",
    "supply": "supply impedance",
}


def test_the_sizes_are_those_that_the_code_of_the_page_finds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1], names)  # noqa: S102
    assert capsys.readouterr().out
    assert names["sizes"].keys() == ROWS.keys()
    for key, title in ROWS.items():
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| {title}"))
        digits, unit = row.split("|")[3].split()
        assert float(digits) * UNITS[unit] == pytest.approx(names["sizes"][key], rel=0.35), key
    before, slower, unstable = names["poles"]
    assert before.real / slower.real == pytest.approx(1.4, abs=0.05)
    assert unstable.real > 0.0
    assert abs(unstable.imag) / 6.2832 == pytest.approx(36e3, rel=0.02)
