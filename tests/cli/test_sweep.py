"""`taction sweep`: the hybrid engine, fixed keys, the line before the start, exit statuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from taction.verification.report.sweep import agreement
from taction.verification.report.sweep import records as records_module
from taction.verification.studies.sweep.comparison import Comparison
from taction.verification.verdict.checks import Outcome
from tests.support.paths import SCENES
from tests.support.running import taction

PAPER = str(SCENES / "paper-breadboard.toml")
OVER = ("--over", "C=50pF:100pF:3", "--fix", "gain=1M", "--fix", "lambda=0.7")


@pytest.mark.parametrize("command", ["verify", "simulate"])
@pytest.mark.parametrize("engine", ["hybrid", "both"])
def test_one_scene_has_no_hybrid_engine(command: str, engine: str) -> None:
    refused = taction(command, PAPER, "--engine", engine)
    assert refused.exit_code == 2
    text = " ".join(refused.stderr.replace("│", " ").split())
    assert f"'{engine}' runs two engines over a grid of points, for `taction sweep` only" in text


def test_a_monte_carlo_study_has_no_hybrid_engine() -> None:
    assert "for `taction sweep` only" in " ".join(
        taction("montecarlo", PAPER, "--engine", "hybrid").stderr.split()
    )


def test_a_scene_has_no_hybrid_engine(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text('[problem]\nkind = "tactile"\n[analysis]\nengine = "hybrid"\n')
    refused = taction("verify", str(file))
    assert refused.exit_code == 2
    assert "analysis.engine = 'hybrid'" in refused.stderr


def test_without_ngspice_the_message_names_the_other_engine(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    refused = taction("sweep", PAPER, *OVER, "--engine", "hybrid", "-o", str(tmp_path / "a.sqlite"))
    assert refused.exit_code == 3
    assert "without ngspice: --engine statespace" in refused.stderr
    assert not (tmp_path / "a.sqlite").exists()


def test_a_hybrid_sweep_from_the_command_line(tmp_path: Path, ngspice: str) -> None:
    words = ("sweep", PAPER, *OVER, "--engine", "hybrid", "--jobs", "1")
    done = taction(*words, "-o", str(tmp_path / "a.sqlite"), "--json")
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    line = r"taction: 3 points and ngspice at about \d of them: about .+ in 1 process"
    assert re.search(line, done.stderr)
    assert document["agreement"]["agree"] == document["agreement"]["points"] > 0
    assert document["estimated_seconds"] > 0.0
    assert all(point["lambda"] == pytest.approx(0.7) for point in document["points"])
    again = taction(*words, "-o", str(tmp_path / "a.sqlite"))
    assert again.exit_code == 0
    assert again.stderr == ""  # nothing is computed, so no time is announced
    assert re.search(r"ngspice confirms (\d) of \1 points", again.stdout)


def test_a_disagreement_ends_with_1(
    tmp_path: Path, ngspice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = Comparison(Outcome.FAIL, 7.0, "overshoot (step): 2 by ngspice")
    monkeypatch.setattr(records_module, "compare", lambda ngspice, statespace: found)
    words = ("sweep", PAPER, *OVER, "--engine", "both", "--jobs", "1")
    done = taction(*words, "-o", str(tmp_path / "a.sqlite"))
    assert done.exit_code == 1
    assert "THE ENGINES DISAGREE at 3 points" in done.stdout
    assert agreement.LINES > 3
    assert done.stdout.count("overshoot (step): 2 by ngspice") == 3


def test_a_key_that_is_fixed_and_changed_is_refused() -> None:
    refused = taction("sweep", PAPER, "--over", "R=1M,2M", "--fix", "lambda")
    assert refused.exit_code == 2
    assert "replaces design.lambda, which --fix holds" in refused.stderr
