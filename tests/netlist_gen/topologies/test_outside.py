"""A topology of another package: every command and medium has it without a change of taction."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import taction
from tests.support.packages import recipe
from tests.support.paths import SCENES
from tests.support.running import taction as command

Plugin = Callable[..., Path]
PACKAGE, ENTRY, SOURCE = recipe("Add a topology")
SHIPPED = SCENES / "eleven-channel.toml"


@pytest.fixture
def folder(plugin: Plugin) -> Path:
    """The folder in which the package of the recipe is installed."""
    return plugin(PACKAGE, ENTRY, SOURCE)


DESIGN = """\
[design]
topology = "shielded"
shielded.cable = "{cable}"
capacitance = "10pF"
lambda = 0.05
gain = "1Mohm"
unit_conductance = "2uS"
stray_capacitance = "0.5pF"
opamp.base = "ideal"
opamp.dc_gain = 2e4
opamp.gbw = "5MHz"
opamp.phase_margin = 60.0
opamp.output_resistance = 500
opamp.input_capacitance = 5e-13

[checks]
"""  # op-amps that cannot drive every cable


def written(folder: Path, cable: str = "470pF") -> Path:
    """A shipped scene with the topology of the recipe and slow op-amps."""
    text = SHIPPED.read_text("utf-8")
    assert "topology" not in text
    before, after = text.partition("[design]\n")[0], text.partition("[checks]\n")[2]
    text = before + DESIGN.format(cable=cable) + after
    path = folder / "board.toml"
    path.write_text(text, "utf-8")
    return path


def run(*words: str) -> str:
    found = command(*words)
    assert found.exit_code == 0, found.stderr + found.stdout
    return found.stdout


def test_the_deck_has_its_parts_and_its_facts(folder: Path) -> None:
    scene = written(folder)
    deck = run("netlist", str(scene))
    assert "* Cc = 4.7e-10 F" in deck
    assert [line for line in deck.splitlines() if line.startswith("Ccable_")] == [
        f"Ccable_{n} v_{n} 0 4.7e-10" for n in range(1, 12)
    ]


def test_verify_has_a_margin_in_its_knob(folder: Path) -> None:
    scene = written(folder)
    found = json.loads(run("verify", str(scene), "--json", "--margins"))
    assert found["outcome"] == "pass"
    margins: dict[str, Any] = found["stability"]["margins"]
    assert set(margins) == {"capacitance", "gain", "cable"}
    factor = margins["cable"]["factor"]
    assert margins["cable"]["text"].startswith(f"the cable can grow by the factor {factor:.4g}")
    # Boards on both sides of the margin, built anew.
    stable = []
    for share in (0.99, 1.01):
        board = written(folder, f"{470.0 * factor * share!r}pF")
        stable.append(taction.verify(board, engine="statespace").poles.stable)
    assert stable == [True, False]


def test_a_sweep_moves_its_key(folder: Path) -> None:
    scene = written(folder)
    found = json.loads(
        run(
            "sweep", str(scene), "--over", "shielded.cable=100pF,10nF", "--json",
            "--engine", "statespace", "--jobs", "1", "-o", str(folder / "s.sqlite"),
        )
    )  # fmt: skip
    points = found["points"]
    assert [point["values"]["shielded.cable"] for point in points] == [100e-12, 10e-9]
    assert [point["stable"] for point in points] == [True, False]


@pytest.mark.nightly  # confirmed by transients of ngspice: 25 s
def test_an_onset_moves_its_key(folder: Path) -> None:
    scene = str(written(folder))
    found = json.loads(run("onset", scene, "--over", "shielded.cable", "--json"))
    crossings = found["crossings"]
    assert [each["confirmed"] for each in crossings] == [True] * 2
    assert 100e-12 < min(each["value"] for each in crossings) < 10e-9


def test_a_fault_of_its_facts_is_caught(plugin: Plugin) -> None:
    """The topology states half of the lambda that its resistors have."""
    wrong = SOURCE.replace(
        "            **super().facts(scene),\n",
        "            **common_facts(**{n: f.value * (0.5 if n == 'lambda' else 1.0)"
        " for n, f in super().facts(scene).items()}),\n",
    ).replace("Fact, Knob", "Fact, Knob, common_facts")
    assert wrong != SOURCE
    folder = plugin(PACKAGE, ENTRY, wrong)
    verdict = taction.verify(written(folder), engine="statespace")
    assert verdict.outcome.value != "pass"
    assert "the board states lambda" in str(verdict)
