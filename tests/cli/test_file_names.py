"""Names that no file can have: a message and exit status 2, never a traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.running import taction

LONG = "n" * 300
PINS = "--subckt FET100 --pins inp,inn,vcc,vee,out"
COMMANDS = [
    "verify {long}.toml", "verify loop.toml", "verify a.toml --report {long}.html",
    "verify a.toml --plot {long}.svg", "check {long}.cir", "check loop.cir",
    "check filter.cir -o {long}.cir", "check filter.cir --tolerances {long}.toml",
    "netlist a.toml -o {long}.cir", "netlist a.toml -o loop.cir", "new {long}.toml",
    "new x.toml --matrix {long}.csv --strain e.csv", "build a.toml -o {long}", "diff {long} a.toml",
    "diff loop.cir a.toml", "regress . --baseline {long}.json",
    "regress {long} --baseline b.json", f"parts import {{long}}.lib {PINS}",
    f"parts import loop.cir {PINS}",
    f"parts import {ROOT}/tests/data/fet100.cir {PINS} -o {{long}}",
    "export bom a.toml -o {long}.csv", "export kicad a.toml -o {long}",
    "export waveforms a.toml -o {long}.csv", "yield montecarlo a.toml -n 5 -o {long}.csv",
    "sweep a.toml --over C=1pF -o {long}.csv", "demo -o {long}.html", "mcp {long}", "mcp loop.cir",
    "onset a.toml --over gain --report {long}.html", "design tune a.toml -o {long}.toml",
    "explore {long}.toml", "self accuracy {long}.toml",
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_a_name_that_no_file_can_have(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text((ROOT / "scenes" / "inverse.toml").read_text())
    (tmp_path / "filter.cir").write_text("t\nV1 in 0 AC 1\nR1 in out 1k\nC1 out 0 1n\n.end\n")
    for ending in (".toml", ".cir"):
        (tmp_path / f"loop{ending}").symlink_to(tmp_path / f"other{ending}")
        (tmp_path / f"other{ending}").symlink_to(tmp_path / f"loop{ending}")
    result = taction(*command.format(long=LONG).split())
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    said = " ".join(result.stderr.split())
    assert "n" * 50 in said or "loop" in said
    assert "expected" in said or "Too many levels" in said or "too long" in said
